"use strict";
// Maps of layers in the Equal Earth projection (Šavrič, Patterson and Jenny, Int. J. Geogr. Inf. Sci. 33 (2019) 454).
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const $ = (id) => document.getElementById(id);
  const canvas = $("canvas"), scale = $("scale");
  const A1 = 1.340264, A2 = -0.081106, A3 = 0.000893, A4 = 0.003796, M = Math.sqrt(3) / 2, RAD = Math.PI / 180;
  const chosen = { layer: 0 }, values = new Map();
  const colours = Uint8Array.from(data.colours[0].match(/../g), (two) => parseInt(two, 16));
  const slope = (t) => { const t2 = t * t, t6 = t2 * t2 * t2; return A1 + 3 * A2 * t2 + t6 * (7 * A3 + 9 * A4 * t2); };
  const height = (t) => { const t2 = t * t, t6 = t2 * t2 * t2; return t * (A1 + A2 * t2 + t6 * (A3 + A4 * t2)); };
  const TOP = height(Math.asin(M)), WIDE = Math.PI / (M * A1);
  const place = (lon, lat) => { // degrees to units of the Earth's radius
    const t = Math.asin(M * Math.sin(lat * RAD));
    return [lon * RAD * Math.cos(t) / (M * slope(t)), height(t)];
  };

  const unpacked = async (layer) => {
    const packed = Uint8Array.from(atob(layer.data), (letter) => letter.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
    const buffer = await new Response(stream).arrayBuffer();
    return layer.bytes === 1 ? new Uint8Array(buffer) : new Uint16Array(buffer);
  };
  const valueOf = (layer, step) => {
    if (step === (layer.bytes === 1 ? 255 : 65535)) return NaN;
    const share = step / layer.top;
    return layer.log ? layer.low * Math.pow(layer.high / layer.low, share) : layer.low + share * (layer.high - layer.low);
  };
  const rowOf = (names) => names.reduce((row, name) => row * data.coordinates[name].length + (chosen[name] || 0), 0);
  const shownOf = (layer) => layer.shown[rowOf(layer.alone)];
  const shareOf = (layer, value) => {
    const [low, high] = shownOf(layer);
    const share = layer.log ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low);
    return Math.min(Math.max(share, 0), 1);
  };
  // The unit in which values are shown, and how much of the layer's it is.
  const unitOf = (layer) => {
    const most = Math.max(...shownOf(layer).map(Math.abs));
    if (layer.unit === "s" && most >= 600) return most >= 7200 ? ["h", 3600] : ["min", 60];
    return [{ percent: "%", degree: "°" }[layer.unit] || layer.unit, 1];
  };
  const text = (value, unit) => Number.isFinite(value) ? `${value.toPrecision(4) * 1}${unit ? ` ${unit}` : ""}` : "none";
  const coordinate = (name, value) => {
    if (name === "launch_time" || name === "time") return new Date(Date.parse(data.epoch) + value * 1000).toISOString().slice(0, 16).replace("T", " ") + " UTC";
    const [unit] = data.dimensions[name];
    return typeof value === "string" ? value : name === "assets" ? `at least ${value}` : `${value} ${unit === "degree" ? "°" : unit}`;
  };

  // Which cell each pixel of the map shows: rows of the projection are parallels, so one inverse a row is enough.
  let cells = new Int32Array(0), width = 0, tall = 0, ratio = 1;
  const fit = () => {
    ratio = Math.min(devicePixelRatio || 1, 2);
    width = Math.max(320, Math.round(canvas.parentElement.clientWidth * ratio));
    tall = Math.round(width * TOP / WIDE);
    canvas.width = width; canvas.height = tall;
    cells = new Int32Array(width * tall).fill(-1);
    for (let row = 0; row < tall; row++) {
      const y = TOP * (1 - 2 * (row + 0.5) / tall);
      let t = y;
      for (let turn = 0; turn < 12; turn++) t -= (height(t) - y) / slope(t);
      const sine = Math.sin(t) / M;
      if (Math.abs(sine) > 1) continue;
      const lat = Math.asin(sine) / RAD, per = M * slope(t) / Math.cos(t) / RAD;
      const line = Math.min(Math.floor((lat + 90) / data.step), data.rows - 1) * data.columns;
      for (let column = 0; column < width; column++) {
        const lon = WIDE * (2 * (column + 0.5) / width - 1) * per;
        if (lon >= -180 && lon < 180) cells[row * width + column] = line + Math.min(Math.floor((lon + 180) / data.step), data.columns - 1);
      }
    }
  };

  const layerNow = () => data.layers[chosen.layer];
  const offset = (layer) => rowOf(layer.dims) * data.rows * data.columns;
  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

  const draw = () => {
    const layer = layerNow(), own = values.get(layer.name);
    if (!own) return;
    const first = offset(layer), context = canvas.getContext("2d"), image = context.createImageData(width, tall);
    const table = new Int16Array(layer.bytes === 1 ? 256 : 65536);
    for (let step = 0; step < table.length; step++) {
      const value = valueOf(layer, step);
      table[step] = Number.isFinite(value) ? Math.round(255 * shareOf(layer, value)) : -1;
    }
    for (let pixel = 0; pixel < cells.length; pixel++) {
      if (cells[pixel] < 0) continue;
      const colour = table[own[first + cells[pixel]]], at = 4 * pixel;
      if (colour < 0) continue;
      image.data[at] = colours[3 * colour]; image.data[at + 1] = colours[3 * colour + 1]; image.data[at + 2] = colours[3 * colour + 2]; image.data[at + 3] = 255;
    }
    context.putImageData(image, 0, 0);
    lines(context);
    ruler(layer);
  };

  const trace = (context, points) => {
    context.beginPath();
    let before = null;
    for (const [lon, lat] of points) {
      const [x, y] = place(lon, lat);
      const at = [width * (0.5 + x / (2 * WIDE)), tall * (0.5 - y / (2 * TOP))];
      if (before === null || Math.abs(lon - before) > 180) context.moveTo(...at); else context.lineTo(...at);
      before = lon;
    }
    context.stroke();
  };
  const span = (low, high, step) => Array.from({ length: Math.round((high - low) / step) + 1 }, (_, k) => low + k * step);
  const lines = (context) => {
    context.lineJoin = "round";
    // A dark line with a light one in it is seen on every colour of the scale and without colour.
    for (const [colour, thick] of [["rgba(0,0,0,0.75)", 1.6], ["rgba(255,255,255,0.85)", 0.7]]) {
      context.strokeStyle = colour; context.lineWidth = thick * ratio;
      for (const ring of data.land) trace(context, Array.from({ length: ring.length / 2 }, (_, k) => [ring[2 * k], ring[2 * k + 1]]));
    }
    context.strokeStyle = "rgba(128,128,128,0.55)"; context.lineWidth = 0.6 * ratio;
    for (const lat of span(-60, 60, 30)) trace(context, span(-180, 180, 5).map((lon) => [lon, lat]));
    for (const lon of span(-120, 120, 60)) trace(context, span(-90, 90, 5).map((lat) => [lon, lat]));
    context.strokeStyle = css("muted"); context.lineWidth = ratio;
    for (const lon of [-180, 180]) trace(context, span(-90, 90, 2).map((lat) => [lon, lat]));
  };

  const ticks = (layer) => {
    const [, size] = unitOf(layer), [low, high] = shownOf(layer).map((each) => each / size);
    if (layer.log) {
      const found = [];
      for (let power = Math.floor(Math.log10(low)); power <= Math.log10(high); power++) for (const digit of [1, 2, 5]) found.push(digit * 10 ** power);
      const inside = found.filter((each) => each >= low && each <= high);
      return inside.length > 8 ? inside.filter((each) => Number.isInteger(Math.round(Math.log10(each) * 1e9) / 1e9)) : inside;
    }
    const rough = (high - low) / 5, power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].map((each) => each * power).find((each) => each >= rough);
    const isWhole = Number.isInteger(layer.top) && layer.top <= 254 && layer.top === Math.round(layer.high - layer.low);
    const own = isWhole ? Math.max(1, Math.round(step)) : step;
    return span(Math.ceil(low / own) * own, Math.floor(high / own) * own, own).map((each) => Math.round(each / own) * own);
  };
  const ruler = (layer) => {
    const box = scale.getBoundingClientRect(), context = scale.getContext("2d");
    scale.width = Math.round(box.width * ratio); scale.height = Math.round(box.height * ratio);
    const edge = 14 * ratio, long = scale.width - 2 * edge, deep = 14 * ratio, below = 4 * ratio;
    for (let column = 0; column < long; column++) {
      const colour = 3 * Math.round(255 * column / (long - 1));
      context.fillStyle = `rgb(${colours[colour]},${colours[colour + 1]},${colours[colour + 2]})`;
      context.fillRect(edge + column, 0, 1.5, deep);
    }
    context.strokeStyle = css("muted"); context.lineWidth = ratio; context.strokeRect(edge, 0.5, long, deep);
    context.fillStyle = css("ink"); context.font = `${12 * ratio}px system-ui, "DejaVu Sans", sans-serif`; context.textAlign = "center"; context.textBaseline = "top";
    const [unit, size] = unitOf(layer);
    let end = -1e9;
    for (const value of ticks(layer)) {
      const x = edge + long * shareOf(layer, value * size), words = text(value, "");
      context.fillRect(x - 0.5 * ratio, deep, ratio, below);
      const half = context.measureText(words).width / 2, middle = Math.min(Math.max(x, half), scale.width - half);
      if (middle - half > end + 6 * ratio) { context.fillText(words, middle, deep + below + ratio); end = middle + half; }
    }
    context.textAlign = "left";
    const marks = [`${layer.title}${unit ? ` [${unit}]` : ""}`, layer.log ? "logarithmic" : "", data.difference ? "difference" : ""];
    context.fillText(marks.filter(Boolean).join(", "), edge, deep + below + 17 * ratio);
  };

  const show = async () => {
    const layer = layerNow();
    $("definition").textContent = `${layer.definition}; no colour: none`;
    if (!values.has(layer.name)) values.set(layer.name, await unpacked(layer));
    const times = layer.dims.includes("time") ? data.coordinates.time : null;
    $("clock").hidden = times === null;
    if (times) { $("time").max = times.length - 1; $("time").value = chosen.time || 0; $("instant").textContent = coordinate("time", times[chosen.time || 0]); }
    canvas.setAttribute("aria-label", `Map: ${layer.title}`);
    draw();
    document.body.dataset.ready = layer.name;
  };
  const choices = () => {
    $("choices").replaceChildren(...layerNow().dims.filter((name) => name !== "time").map((name) => {
      const label = document.createElement("label"), select = document.createElement("select");
      label.append(`${name.replace("_", " ").replace(/^./, (letter) => letter.toUpperCase())} `, select);
      data.coordinates[name].forEach((value, row) => select.append(new Option(coordinate(name, value), row)));
      select.id = `choose-${name}`; select.value = chosen[name] || 0;
      select.addEventListener("change", () => { chosen[name] = Number(select.value); show(); });
      return label;
    }));
  };
  const at = (event) => {
    const box = canvas.getBoundingClientRect();
    const pixel = Math.floor((event.clientY - box.top) * tall / box.height) * width + Math.floor((event.clientX - box.left) * width / box.width);
    const cell = cells[pixel], layer = layerNow(), own = values.get(layer.name);
    if (cell === undefined || cell < 0 || !own) return;
    const lat = Math.floor(cell / data.columns) * data.step - 90 + data.step / 2, lon = (cell % data.columns) * data.step - 180 + data.step / 2;
    const words = `${Math.abs(lat)}° ${lat < 0 ? "S" : "N"} ${Math.abs(lon)}° ${lon < 0 ? "W" : "E"}`;
    const [unit, size] = unitOf(layer);
    $("reading").textContent = `${words}: ${text(valueOf(layer, own[offset(layer) + cell]) / size, unit)}`;
  };

  data.layers.forEach((layer, row) => $("layer").append(new Option(layer.title, row)));
  $("layer").addEventListener("change", () => { chosen.layer = Number($("layer").value); choices(); show(); });
  $("time").addEventListener("input", () => { chosen.time = Number($("time").value); show(); });
  canvas.addEventListener("pointermove", at);
  let playing = null;
  $("play").addEventListener("click", () => {
    if (playing !== null) { clearInterval(playing); playing = null; } else {
      playing = setInterval(() => { chosen.time = ((chosen.time || 0) + 1) % data.coordinates.time.length; show(); }, 120);
    }
    $("play").textContent = playing === null ? "Play" : "Stop"; $("play").setAttribute("aria-pressed", String(playing !== null));
  });
  const again = () => { fit(); draw(); };
  addEventListener("resize", again);
  for (const query of ["(prefers-color-scheme: dark)", "print"]) matchMedia(query).addEventListener("change", draw);
  addEventListener("beforeprint", draw);
  const named = data.layers.findIndex((layer) => layer.name === location.hash.slice(1));
  if (named >= 0) { chosen.layer = named; $("layer").value = named; }
  fit(); choices(); show();
})();
