r"""Crosstalk and a dome's albedo by eye: a viewer turns a level until nothing changes any more.

Fechner's method of adjustment (*Elemente der Psychophysik*, 1860), as a null: two pictures take
turns, half a second each, and differ in nothing but what is measured and a level that answers it.
At the null nothing moves, so neither the eye's own response nor how bright the room is matters.
Light that stays (black, exit signs, an uneven screen) is in both pictures and cancels.

Levels are code values, 0..1. L(v) is light of code v above black, in units of the primary's full
light.

*Response.* Codes v_1, v_2, ... have a quarter, a sixteenth, ... of full light: the viewer matches
an even field of v_k with a pattern of which a quarter has v_(k-1) and the rest is black (the dither
match). On a screen these are lines and a field beside each other, which blurred sight makes one.
In a dome thin wedges and the whole of the rear half take turns: both are seen as light that the
dome reflects to its front. ln L is a polynomial in ln v, which a power law and sRGB are.

*Crosstalk.* One eye looks, the other is covered. The other eye's picture has bars of full light,
which are seen as c. The looking eye's picture is grey, h, with bars of a darker l in the same
places; twice a second all bars and gaps change places. At the null c = L(h) - L(l). What leaks of
the other projector's black is in both pictures.

*Albedo.* The rear half of a dome is lit fully, then the front half with level x. The front half
sees what the rear one reflects, r_1, against its own light with what that reflects onto itself,
x (1 + r_2). At the null x = r_1 / (1 + r_2), which rises with the albedo; on a bare sphere r is the
closed form. The viewer looks at the front, so that the rear half's direct light is out of sight.

A setting stops where the change can no longer be seen, on the side that it comes from: settings
from both sides take turns, and the mean of both sides is free of what is alike in both.

Ives (1912) and those after him null flicker at 10 to 20 Hz, where colours fuse. Here both sides of
a null have one colour, and twice a second is harmless to those whom flicker makes ill (WCAG 2.2,
2.3.1: three flashes a second). To, Woods, Goldstein and Peli (2013) calibrate displays by eye.
"""
