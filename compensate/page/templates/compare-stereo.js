"use strict";
// What two eyes make of a view: the anaglyph, and the ghost (light of one eye's picture that reached
// the other eye). Pictures are numbered as they are stored: each view's left eye's, then its right eye's.
const domesimStereo = (() => {
  const { page, LUMA, nits, levels } = domesimLight;
  const PLAIN = ["left", "right", "both", "wiggle"]; // these show pictures as they are
  const pictureOf = (view, eye) => (page.stereo ? 2 * view + (eye === "right" ? 1 : 0) : view);

  // Red-cyan anaglyph of least squares in CIE XYZ: E. Dubois, "A projection method to generate
  // anaglyph stereo images", ICASSP 2001. For a CRT's primaries and the filters REEL3D 7003, from
  // the spectra in W. Sanders and D. McAllister, "Producing anaglyphs from synthetic images", SPIE
  // 5006 (2003). Rows: R, G, B of the anaglyph; columns: R, G, B of the left eye, then of the right.
  const DUBOIS = [
    [0.4561, 0.5005, 0.1764, -0.0435, -0.0879, -0.0016],
    [-0.0401, -0.0378, -0.0158, 0.3785, 0.7336, -0.0185],
    [-0.0152, -0.0206, -0.0055, -0.0722, -0.113, 1.2264],
  ];

  // Linear light in cd/m², below zero where no light can keep the other eye's out.
  function anaglyph(left, right, i, light) {
    const plane = left.rows * left.cols;
    for (let c = 0; c < 3; c++) {
      light[c] = 0;
      for (let from = 0; from < 3; from++)
        light[c] += DUBOIS[c][from] * nits[left.codes[from * plane + i]]
          + DUBOIS[c][3 + from] * nits[right.codes[from * plane + i]];
    }
  }

  // Luminance of what is too much, and of what is too little. Split by primary: a ghost that is too
  // red and too little blue does not cancel.
  function residual(level, wanted, i) {
    const plane = level.rows * level.cols, found = { excess: 0, lack: 0 };
    for (let c = 0; c < 3; c++) {
      const off = LUMA[c] * (nits[level.codes[c * plane + i]] - nits[wanted.codes[c * plane + i]]);
      found[off > 0 ? "excess" : "lack"] += Math.abs(off);
    }
    return found;
  }

  const EXCESS = [1, 0.5, 0.1], LACK = [0.1, 0.4, 1]; // amber and blue, linear
  function ghost(level, wanted, i, light) {
    const { excess, lack } = residual(level, wanted, i);
    for (let c = 0; c < 3; c++) light[c] = excess * EXCESS[c] + lack * LACK[c];
  }

  const means = new Map();
  function meanResidual(picture, wanted) {
    const key = `${picture} ${wanted}`;
    if (!means.has(key)) {
      const level = levels[picture][0], mean = { excess: 0, lack: 0 };
      let lit = 0;
      for (let i = 0; i < level.alpha.length; i++) {
        if (!level.alpha[i]) continue;
        const { excess, lack } = residual(level, levels[wanted][0], i);
        mean.excess += excess;
        mean.lack += lack;
        lit++;
      }
      means.set(key, { excess: mean.excess / lit, lack: mean.lack / lit });
    }
    return means.get(key);
  }

  return { PLAIN, pictureOf, anaglyph, ghost, meanResidual };
})();
