// A host for shaders in the Interactive Shader Format, version 2, as its text says: passes are drawn in order, each
// sees what those before it drew in this frame, and its own target as it was; targets with FLOAT have 32 bits.

function isfHost(source, width, height) {
  const canvas = document.createElement("canvas");
  const gl = canvas.getContext("webgl2", { antialias: false });
  if (!gl || !gl.getExtension("EXT_color_buffer_float")) throw new Error("no WebGL 2 with EXT_color_buffer_float");
  const filter = gl.getExtension("OES_texture_float_linear") ? gl.LINEAR : gl.NEAREST;
  const header = JSON.parse(source.match(/^\/\*([\s\S]*?)\*\//)[1]);
  const passes = header.PASSES.map((pass) => ({
    name: pass.TARGET,
    float: !!pass.FLOAT,
    width: +(pass.WIDTH ?? width),
    height: +(pass.HEIGHT ?? height),
  }));
  const images = ["inputImage", ...passes.filter((pass) => pass.name).map((pass) => pass.name)];
  const types = { image: "sampler2D", bool: "bool", float: "float" };
  const declared = [
    "precision highp float; precision highp int; varying vec2 isf_FragNormCoord;",
    "uniform int PASSINDEX; uniform vec2 RENDERSIZE;",
    ...images.slice(1).map((name) => `uniform sampler2D ${name};`),
    ...images.map((name) => `uniform vec2 _${name}_size;`),
    ...header.INPUTS.map((input) => `uniform ${types[input.TYPE]} ${input.NAME};`),
  ].join("\n");
  const body = source
    .replace(/IMG_SIZE\((\w+)\)/g, "_$1_size")
    .replace(/IMG_THIS_PIXEL\((\w+)\)/g, "texture2D($1, isf_FragNormCoord)")
    .replace(/IMG_NORM_PIXEL\((\w+), *(\w+)\)/g, "texture2D($1, $2)");

  const program = gl.createProgram();
  for (const [kind, text] of [
    [gl.VERTEX_SHADER, "attribute vec2 at; varying vec2 isf_FragNormCoord; void main() { isf_FragNormCoord = at; gl_Position = vec4(2.0 * at - 1.0, 0.0, 1.0); }"],
    [gl.FRAGMENT_SHADER, `${declared}\n${body}`],
  ]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(program, shader);
  }
  gl.bindAttribLocation(program, 0, "at");
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  gl.useProgram(program);
  gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([0, 0, 2, 0, 0, 2]), gl.STATIC_DRAW);
  gl.enableVertexAttribArray(0);
  gl.vertexAttribPointer(0, 2, gl.FLOAT, false, 0, 0);

  const place = (name) => gl.getUniformLocation(program, name);
  const texture = (wide, high, float) => {
    const made = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, made);
    gl.texStorage2D(gl.TEXTURE_2D, 1, float ? gl.RGBA32F : gl.RGBA8, wide, high);
    for (const [key, value] of [
      [gl.TEXTURE_MIN_FILTER, float ? filter : gl.LINEAR],
      [gl.TEXTURE_MAG_FILTER, float ? filter : gl.LINEAR],
      [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE],
      [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE],
    ]) gl.texParameteri(gl.TEXTURE_2D, key, value);
    return made;
  };
  const input = texture(width, height, false);
  for (const pass of passes) [pass.seen, pass.drawn] = [0, 1].map(() => texture(pass.width, pass.height, pass.float || !pass.name));
  const buffer = gl.createFramebuffer();

  // Codes (row, col, RGBA) of a frame, first row on top, and values of inputs -> codes of 255, not rounded.
  return (codes, values) => {
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, input);
    const rows = [];
    for (let row = height - 1; row >= 0; row--) rows.push(...codes.subarray(4 * width * row, 4 * width * (row + 1)));
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(rows));
    for (const each of header.INPUTS) {
      if (each.TYPE === "float") gl.uniform1f(place(each.NAME), values[each.NAME] ?? each.DEFAULT);
      if (each.TYPE === "bool") gl.uniform1i(place(each.NAME), values[each.NAME] ?? each.DEFAULT);
    }
    gl.uniform1i(place("inputImage"), 0);
    gl.uniform2f(place("_inputImage_size"), width, height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, buffer);
    passes.forEach((pass, index) => {
      passes.forEach((other, k) => {
        if (!other.name) return;
        gl.activeTexture(gl.TEXTURE1 + k);
        gl.bindTexture(gl.TEXTURE_2D, other.seen);
        gl.uniform1i(place(other.name), 1 + k);
        gl.uniform2f(place(`_${other.name}_size`), other.width, other.height);
      });
      gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, pass.drawn, 0);
      gl.viewport(0, 0, pass.width, pass.height);
      gl.uniform1i(place("PASSINDEX"), index);
      gl.uniform2f(place("RENDERSIZE"), pass.width, pass.height);
      gl.drawArrays(gl.TRIANGLES, 0, 3);
      if (pass.name) [pass.seen, pass.drawn] = [pass.drawn, pass.seen];
    });
    const found = new Float32Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.FLOAT, found);
    if (gl.getError()) throw new Error("WebGL has an error");
    const upright = [];
    for (let row = height - 1; row >= 0; row--) upright.push(...found.subarray(4 * width * row, 4 * width * (row + 1)));
    return upright.map((value) => 255 * value);
  };
}
