"""Two eyes: how their contrasts combine, where they rival, and what crosstalk does to that.

`contrast` holds two published models of how the two eyes' contrasts make one, `rivalry` the ratio
of contrasts by which they rival, `disparity` finds what belongs together in a pair. `pair` puts
them together: what two eyes see of a master in a theatre.

Other published models are left out, because their formulae or constants were not found in any text
that could be read: Georgeson, Wallis, Meese and Baker 2016 (maximum of three channels, and lustre);
the metric of Xing, You, Ebrahimi and Perkis 2012 (map of structural similarity and depth); Kim,
Kim, Lee and Bovik 2017; the thresholds by contrast and disparity of Wang et al. 2011; and the loss
of depth of Tsirlin, Wilcox and Allison 2011. ``docs/two-eyes.md`` says what is known of each.
"""
