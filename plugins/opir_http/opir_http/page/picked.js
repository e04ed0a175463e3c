// Small plots of the selected track: its probability, the area of its region and its altitude over time, and the region.
import { ellipse, rewound } from "/page/earth.js";
import { byId, whole } from "/page/panels.js";
import { likeliest } from "/page/order.js";
import { areaKm2, areaWords, outer } from "/page/table.js";

const { geoOrthographic, geoPath } = globalThis.d3;
const ROWS = 3, LABEL_PX = 15, WIDEST_KM2 = 1.2e8;

// What the picture of the region was last drawn for.
let drawn = "";

// The three curves of a track up to a time: title, values, limits and the last value as text.
export function curvesOf(track, timeS) {
  const past = track.past.filter((each) => each.timeS <= timeS);
  if (!past.length) return [];
  const name = likeliest(past[past.length - 1].document), chances = (report) => report.hypotheses || report.type_probability;
  const curve = (title, value, text, limits, isLog = false) => {
    const points = past.map((each) => [each.timeS, value(each.document)]).filter(([, y]) => Number.isFinite(y) && (!isLog || y > 0));
    return { title, points, limits, isLog, text: points.length ? text(points[points.length - 1][1]) : "–" };
  };
  return [
    curve(`P(${name})`, (report) => chances(report)[name] ?? NaN, (y) => (y >= 0.995 ? "> 0.99" : y < 0.005 ? "< 0.01" : y.toFixed(2)), [0, 1]),
    curve("95 % area, log", areaKm2, (y) => areaWords(y, " km²"), null, true),
    curve("Altitude", (report) => (report.altitude_m === null ? NaN : report.altitude_m / 1000), (y) => `${whole.format(Math.round(y))} km`, null),
  ];
}

export function drawPicked(track, timeS, layers) {
  const box = byId("plots"), report = track && track.past.filter((each) => each.timeS <= timeS).pop();
  box.hidden = !report;
  if (!report) return;
  const curves = curvesOf(track, timeS);
  drawCurves(byId("history"), curves, layers.colour);
  byId("history").setAttribute("aria-label", `History: ${curves.map((each) => `${each.title} ${each.text}`).join("; ")}`);
  const now = `${report.document.track_id} ${report.timeS} ${layers.groundVersion} ${layers.colour.sea} ${byId("region").clientWidth}`;
  if (now !== drawn) { drawn = now; drawRegion(byId("region"), report.document, layers); }
}

function sized(canvas) {
  const ratio = Math.min(devicePixelRatio || 1, 2), wide = canvas.clientWidth, tall = canvas.clientHeight, pen = canvas.getContext("2d");
  canvas.width = Math.round(wide * ratio); canvas.height = Math.round(tall * ratio);
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  return { pen, wide, tall };
}

function drawCurves(canvas, curves, colour) {
  const { pen, wide, tall } = sized(canvas), row = tall / ROWS;
  const times = curves.flatMap((each) => each.points.map(([time]) => time)), first = Math.min(...times), spanS = Math.max(...times) - first || 1;
  curves.forEach(({ title, points, limits, isLog, text }, at) => {
    const top = at * row, scale = (y) => (isLog ? Math.log10(y) : y), values = points.map(([, y]) => scale(y));
    const low = limits ? limits[0] : Math.min(...values), high = limits ? limits[1] : Math.max(...values);
    pen.font = "11px system-ui, sans-serif"; pen.fillStyle = colour.soft; pen.textBaseline = "top"; pen.textAlign = "left";
    pen.fillText(title, 0, top);
    pen.textAlign = "right"; pen.fillStyle = colour.ink; pen.fillText(text, wide, top);
    pen.strokeStyle = colour.line; pen.lineWidth = 1; pen.beginPath(); pen.moveTo(0, top + row - 3); pen.lineTo(wide, top + row - 3); pen.stroke();
    pen.strokeStyle = colour.select; pen.lineWidth = 1.6; pen.beginPath();
    points.forEach(([time, y], number) => {
      const x = 1 + ((time - first) / spanS) * (wide - 2), down = top + row - 4 - ((scale(y) - low) / (high - low || 1)) * (row - LABEL_PX - 5);
      if (number) pen.lineTo(x, down); else pen.moveTo(x, down);
    });
    pen.stroke();
  });
}

// The region of the impact point on a globe of its own, turned and zoomed to it.
function drawRegion(canvas, report, layers) {
  const { pen, wide, tall } = sized(canvas), impact = report.impact_point, regions = (report.impact_regions || []).filter((each) => each.condition === (outer(report) || {}).condition);
  canvas.hidden = !impact;
  if (!impact) return;
  const shapes = regions.length ? regions.map((each) => rewound(each.geometry)) : [impact.ellipse_50, impact.ellipse].filter(Boolean).map((shape) => ellipse(impact, shape));
  const projection = geoOrthographic().rotate([-impact.lon_deg, -impact.lat_deg]).clipAngle(90), edge = 12, box = [[edge, edge], [wide - edge, tall - edge]];
  const isWide = !shapes.length || areaKm2(report) > WIDEST_KM2;
  projection.fitExtent(box, isWide ? { type: "Sphere" } : shapes[shapes.length - 1]);
  // Not closer than a hundred kilometres across.
  projection.scale(Math.min(projection.scale(), 60 * wide)).precision(0.5).clipExtent([[0, 0], [wide, tall]]);
  const path = geoPath(projection, pen), draw = (shape) => { pen.beginPath(); path(shape); };
  draw({ type: "Sphere" }); pen.fillStyle = layers.colour.sea; pen.fill();
  const land = layers.land[isWide ? "110m" : "50m"] || layers.land["110m"];
  if (land) { draw(land); pen.fillStyle = layers.colour.land; pen.fill(); pen.strokeStyle = layers.colour.shore; pen.lineWidth = 0.6; pen.stroke(); }
  pen.strokeStyle = pen.fillStyle = layers.colour.impact; pen.lineWidth = 1.3;
  for (const shape of shapes) { draw(shape); pen.globalAlpha = 0.15; pen.fill(); pen.globalAlpha = 1; pen.stroke(); }
  if (!isWide) {
    const km = 2 * Math.asin(Math.min(1, wide / 2 / projection.scale())) * 6371;
    pen.font = "11px system-ui, sans-serif"; pen.fillStyle = layers.colour.soft; pen.textAlign = "left"; pen.textBaseline = "bottom";
    pen.fillText(`${whole.format(Number(km.toPrecision(2)))} km wide`, 4, tall - 3);
  }
  pen.strokeStyle = layers.colour.impact;
  const [x, y] = projection([impact.lon_deg, impact.lat_deg]);
  pen.lineWidth = 1.8; pen.beginPath(); pen.moveTo(x - 4, y - 4); pen.lineTo(x + 4, y + 4); pen.moveTo(x - 4, y + 4); pen.lineTo(x + 4, y - 4); pen.stroke();
}
