"use strict";
// The dome from a seat: rays from the eye to the screen, whose light is the picture's there. It is the
// same from everywhere, for the screen is matt. Lengths are in metres, in the room's frame: x to the
// audience's right, y to their front, z up; the dome's frame leans by its tilt (domesim/room/dome.py).
const domesimDome = (() => {
  const { page } = domesimLight;
  const { dome } = page;
  if (!dome) return null;
  const RADIANS = Math.PI / 180;
  const half = dome.halfAngle * RADIANS, lean = dome.tilt * RADIANS;
  const CENTRE = { name: "centre of the sphere", eye: [0, 0, 0], lookAt: [0, Math.cos(30 * RADIANS), Math.sin(30 * RADIANS)], field: 100 };
  const seats = dome.seats.length ? dome.seats : [CENTRE];
  const circle = Math.min(page.rows, page.cols) / 2; // pixels
  const cut = dome.truncatedBelow ?? -1e9;
  const floor = dome.floor || [-1e9, 0], wall = dome.wall || [0, 0, 0];
  const NEAR = 20, WIDE = 150; // degrees of field

  // Where a seat's view begins: `turn` from the front to the right, `rise` above the horizon.
  function facing(seat) {
    const [x, y, z] = seats[seat].lookAt.map((part, i) => part - seats[seat].eye[i]);
    return { turn: Math.atan2(x, y) / RADIANS, rise: Math.atan2(z, Math.hypot(x, y)) / RADIANS, field: seats[seat].field };
  }

  function axes({ turn, rise }) {
    const [s, c, t, u] = [Math.sin(turn * RADIANS), Math.cos(turn * RADIANS), Math.sin(rise * RADIANS), Math.cos(rise * RADIANS)];
    return { right: [c, -s, 0], up: [-s * t, -c * t, u], forward: [s * u, c * u, t] };
  }

  // Columns: what a step to the right, a step up (from -1 to 1 across the view) and the middle add to a ray.
  function basis(look, width, height) {
    const { right, up, forward } = axes(look), reach = Math.tan((look.field * RADIANS) / 2);
    return [...right.map((v) => v * reach), ...up.map((v) => (v * reach * height) / width), ...forward];
  }

  const toDome = ([x, y, z]) => [x, y * Math.cos(lean) - z * Math.sin(lean), y * Math.sin(lean) + z * Math.cos(lean)];
  const toRoom = ([x, y, z]) => [x, y * Math.cos(lean) + z * Math.sin(lean), -y * Math.sin(lean) + z * Math.cos(lean)];

  // Row and column (with fractions) of the picture that a ray meets, as the shader has it.
  function pictureAt(eye, ray) {
    const p = toDome(eye), v = toDome(ray), ratio = dome.heightRatio;
    p[2] /= ratio;
    v[2] /= ratio;
    const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    const a = dot(v, v), b = dot(p, v), c = dot(p, p) - dome.radius ** 2;
    const far = (Math.sqrt(Math.max(0, b * b - a * c)) - b) / a;
    const q = p.map((part, i) => part + far * v[i]);
    q[2] *= ratio;
    const ring = Math.hypot(q[0], q[1]), reach = Math.atan2(ring, q[2]) / half;
    const at = (k) => (ring ? (reach * q[k]) / ring : 0);
    return { row: page.rows / 2 + circle * at(1), col: page.cols / 2 + circle * at(0), onScreen: reach <= 1 && toRoom(q)[2] >= cut };
  }

  function rayAt(look, x, y, width, height) {
    const m = basis(look, width, height), u = (2 * x) / width - 1, v = 1 - (2 * y) / height;
    return [0, 1, 2].map((i) => m[i] * u + m[3 + i] * v + m[6 + i]);
  }

  // Where a pixel of the picture is in a view, or null if it is behind.
  function placeOf(eye, look, row, col, width, height) {
    const u = (col - page.cols / 2) / circle, v = (row - page.rows / 2) / circle, ring = Math.hypot(u, v);
    const theta = ring * half, side = ring ? Math.sin(theta) / ring : 0;
    const way = [u * side, v * side, Math.cos(theta)];
    const distance = dome.radius / Math.hypot(way[0], way[1], way[2] / dome.heightRatio);
    const ray = toRoom(way.map((part) => part * distance)).map((part, i) => part - eye[i]);
    const { right, up, forward } = axes(look), reach = Math.tan((look.field * RADIANS) / 2);
    const dot = (a) => a[0] * ray[0] + a[1] * ray[1] + a[2] * ray[2];
    const deep = dot(forward);
    if (deep <= 0) return null;
    return { x: (width / 2) * (1 + dot(right) / deep / reach), y: height / 2 - ((width / 2) * dot(up)) / deep / reach };
  }

  const VERTEX = `#version 300 es
    out vec2 at;
    void main() { // one triangle that covers the view
      at = vec2(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0);
      gl_Position = vec4(at, 0.0, 1.0);
    }`;
  const FRAGMENT = `#version 300 es
    precision highp float;
    uniform vec3 eye, wall;
    uniform mat3 basis, toDome;
    uniform vec4 dome; // radius, height ratio, half angle, height below which there is no screen
    uniform vec2 ground; // height, radius
    uniform vec2 circle; // radius, in shares of the picture's sides
    uniform sampler2D picture;
    in vec2 at;
    out vec4 colour;
    vec3 encoded(vec3 light) {
      return mix(12.92 * light, 1.055 * pow(light, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, light));
    }
    void main() {
      vec3 ray = normalize(basis * vec3(at, 1.0));
      vec3 p = toDome * eye, v = toDome * ray;
      p.z /= dome.y;
      v.z /= dome.y;
      float a = dot(v, v), b = dot(p, v), c = dot(p, p) - dome.x * dome.x;
      float far = (sqrt(max(0.0, b * b - a * c)) - b) / a;
      vec3 q = p + far * v;
      q.z *= dome.y;
      float ring = length(q.xy), reach = atan(ring, q.z) / dome.z;
      vec2 place = 0.5 + circle * reach * q.xy / max(ring, 1e-9);
      vec4 light = texture(picture, place); // everywhere: its level of detail needs the neighbours
      float down = (ground.x - eye.z) / ray.z;
      vec3 foot = eye + down * ray;
      vec2 grid = abs(fract(foot.xy - 0.5) - 0.5) / fwidth(foot.xy);
      float line = 1.0 - min(1.0, min(grid.x, grid.y));
      float u = dot(ray.xy, ray.xy), w = dot(eye.xy, ray.xy);
      float aside = (sqrt(max(0.0, w * w - u * (dot(eye.xy, eye.xy) - wall.x * wall.x))) - w) / u;
      float height = eye.z + aside * ray.z;
      bool meetsFloor = down > 0.0 && down < far && length(foot.xy) < ground.y;
      bool meetsWall = wall.x > 0.0 && aside < 0.999 * far && height > wall.y && height < wall.z;
      if (meetsFloor) colour = vec4(vec3(0.075 + 0.06 * line), 1.0); // display codes
      else if (meetsWall || reach > 1.0 || (eye + far * ray).z < dome.w || light.a < 0.02) colour = vec4(vec3(0.05), 1.0);
      else colour = vec4(encoded(light.rgb / light.a), 1.0);
    }`;

  // A canvas on which views are drawn; null where the browser has no WebGL 2.
  function renderer(canvas) {
    const gl = canvas.getContext("webgl2", { alpha: false, antialias: false, xrCompatible: false });
    if (!gl) return null;
    const program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program) || "no shader");
    gl.useProgram(program);
    const at = (name) => gl.getUniformLocation(program, name);
    const [c, s] = [Math.cos(lean), Math.sin(lean)];
    gl.uniformMatrix3fv(at("toDome"), false, [1, 0, 0, 0, c, s, 0, -s, c]);
    gl.uniform4f(at("dome"), dome.radius, dome.heightRatio, half, cut);
    gl.uniform2f(at("ground"), ...floor);
    gl.uniform2f(at("circle"), circle / page.cols, circle / page.rows);
    gl.uniform3f(at("wall"), ...wall);
    const eyeAt = at("eye"), basisAt = at("basis");
    const finer = gl.getExtension("EXT_texture_filter_anisotropic");

    const textures = new Map(), KEPT = 8; // source canvas -> { texture, key }, oldest first
    function bind(source, key) {
      const entry = textures.get(source) || { texture: gl.createTexture(), key: null };
      textures.delete(source);
      textures.set(source, entry);
      gl.bindTexture(gl.TEXTURE_2D, entry.texture);
      if (entry.key === key) return;
      entry.key = key;
      // Codes are decoded to light before they are averaged
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.SRGB8_ALPHA8, gl.RGBA, gl.UNSIGNED_BYTE, source);
      gl.generateMipmap(gl.TEXTURE_2D);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
      if (finer) gl.texParameterf(gl.TEXTURE_2D, finer.TEXTURE_MAX_ANISOTROPY_EXT, 8);
      if (textures.size <= KEPT) return;
      const [oldest, { texture }] = textures.entries().next().value;
      gl.deleteTexture(texture);
      textures.delete(oldest);
    }

    // `box` and `part`, which is drawn of it, from the lower left corner: x, y, width, height.
    function draw(source, key, eye, matrix, box, part = box) {
      gl.enable(gl.SCISSOR_TEST);
      gl.viewport(...box);
      gl.scissor(...part);
      bind(source, key);
      gl.uniform3f(eyeAt, ...eye);
      gl.uniformMatrix3fv(basisAt, false, matrix);
      gl.drawArrays(gl.TRIANGLES, 0, 3);
    }

    function clear() {
      gl.disable(gl.SCISSOR_TEST);
      gl.clearColor(0, 0, 0, 1);
      gl.clear(gl.COLOR_BUFFER_BIT);
    }

    return { gl, draw, clear };
  }

  // A headset shows `shown()`, { source, key }, as long as it likes; its trigger calls `flip`.
  async function enter(view, seat, shown, flip, ended) {
    const { gl } = view;
    const session = await navigator.xr.requestSession("immersive-vr");
    await gl.makeXRCompatible();
    const layer = new XRWebGLLayer(session, gl);
    session.updateRenderState({ baseLayer: layer });
    const space = await session.requestReferenceSpace("local");
    const forward = axes({ ...facing(seat()), rise: 0 }); // a head may nod by itself
    // The headset's x is to the right, y up, z backwards
    const toTheatre = ([x, y, z]) => [0, 1, 2].map((i) => forward.right[i] * x + (i === 2 ? y : 0) - forward.forward[i] * z);
    function frame(_, now) {
      if (over) return;
      session.requestAnimationFrame(frame);
      const pose = now.getViewerPose(space);
      if (!pose) return;
      gl.bindFramebuffer(gl.FRAMEBUFFER, layer.framebuffer);
      const { source, key } = shown();
      for (const each of pose.views) {
        const { x, y, width, height } = layer.getViewport(each);
        const m = each.transform.matrix, p = each.projectionMatrix;
        const turned = (v) => toTheatre([0, 1, 2].map((i) => m[i] * v[0] + m[4 + i] * v[1] + m[8 + i] * v[2]));
        const rays = [[1 / p[0], 0, 0], [0, 1 / p[5], 0], [p[8] / p[0], p[9] / p[5], -1]].flatMap(turned);
        const head = toTheatre([m[12], m[13], m[14]]);
        view.draw(source, key, seats[seat()].eye.map((part, i) => part + head[i]), rays, [x, y, width, height]);
      }
    }
    let over = false;
    session.addEventListener("select", flip);
    session.addEventListener("end", () => {
      over = true;
      gl.bindFramebuffer(gl.FRAMEBUFFER, null);
      ended();
    });
    session.requestAnimationFrame(frame);
    return session;
  }

  return { dome, seats, NEAR, WIDE, facing, basis, rayAt, pictureAt, placeOf, renderer, enter };
})();
