// Many tracks on the map. Their regions, trails and points are drawn into a second canvas, a few milliseconds in each
// frame, which then replaces the one that is shown; marks are stamps. So a thousand tracks leave time for other frames.
const BUDGET_MS = 4, REFRESH_MS = 1000, LEAST_PX = 2, RADIUS_M = 6378137;

function made(width, height) {
  const canvas = document.createElement("canvas");
  canvas.width = width; canvas.height = height;
  return canvas;
}

export class Crowd {
  constructor(layers) {
    this.layers = layers; this.shown = made(1, 1); this.next = made(1, 1); this.stamps = new Map();
    this.work = null; this.version = ""; this.workVersion = ""; this.madeMs = -Infinity; this.counts = null;
  }

  // Draws what `seen` has of each track: { track, report, count, last, isOld, isSelected, hasRegion }.
  draw(seen, isMoving) {
    const { layers } = this, { pen } = layers;
    if (isMoving) {
      this.work = null; this.version = "";
      this.markSites(seen);
    } else this.drawShown(seen);
    for (const { track, last, isOld } of seen) if (last && !isOld) this.mark(track.id, "now", last.place);
    for (const one of seen) if (one.isSelected) layers.drawTrack(one, true);
    pen.globalAlpha = 1;
    layers.drawn = { ...(this.counts || layers.drawn), tracks: seen.length };
  }

  drawShown(seen) {
    const { layers } = this, { pen, canvas, view, colour } = layers, version = `${view.version} ${layers.ratio} ${colour.ink}`;
    if (this.work && this.workVersion !== version) this.work = null;
    if (!this.work && (this.version !== version || performance.now() - this.madeMs > REFRESH_MS)) {
      this.next.width = canvas.width; this.next.height = canvas.height;
      this.work = this.steps(seen); this.workVersion = version;
    }
    if (this.work) this.proceed();
    if (this.version === version) { pen.save(); pen.setTransform(1, 0, 0, 1, 0, 0); pen.drawImage(this.shown, 0, 0); pen.restore(); this.pickSites(seen); }
    else this.markSites(seen);
  }

  // Works for its time of this frame, with the pen of the other canvas.
  proceed() {
    const { layers } = this, { pen, drawn, marks } = layers, end = performance.now() + BUDGET_MS;
    layers.pen = this.next.getContext("2d"); layers.drawn = this.drawn || drawn; layers.marks = [];
    layers.pen.setTransform(layers.ratio, 0, 0, layers.ratio, 0, 0);
    let isDone = false;
    while (!isDone && performance.now() < end) isDone = this.work.next().done;
    this.drawn = layers.drawn;
    Object.assign(layers, { pen, drawn, marks });
    if (!isDone) return;
    [this.shown, this.next] = [this.next, this.shown];
    this.counts = this.drawn; this.drawn = null;
    this.work = null; this.version = this.workVersion; this.madeMs = performance.now();
  }

  * steps(seen) {
    const { layers } = this;
    this.drawn = layers.drawn = { launches: 0, impacts: 0, ellipses: 0, regions: 0, tracks: 0 };
    for (const { track, report, count, isOld, hasRegion } of seen) {
      layers.pen.globalAlpha = isOld ? 0.35 : 0.8;
      if (hasRegion) layers.drawRegions(track.id, report, false, LEAST_PX * RADIUS_M / layers.view.radius);
      layers.drawTrail(track.trail, count, false);
      yield;
    }
    layers.pen.globalAlpha = 1;
    this.markSites(seen);
    for (const { report } of seen) { layers.drawn.launches += report.launch_point ? 1 : 0; layers.drawn.impacts += report.impact_point ? 1 : 0; }
  }

  markSites(seen) {
    const { layers } = this;
    for (const { track, report } of seen) {
      if (report.launch_point) this.mark(track.id, "launch", layers.site(`launch ${track.id}`, report.launch_point));
      if (report.impact_point) this.mark(track.id, "impact", layers.site(`impact ${track.id}`, report.impact_point));
    }
  }

  // Sites that are on the shown canvas can be selected too.
  pickSites(seen) {
    const { layers } = this, { view } = layers;
    for (const { track, report } of seen) {
      if (report.impact_point && view.at(layers.site(`impact ${track.id}`, report.impact_point))) layers.marks.push({ key: `track ${track.id}`, x: view.px, y: view.py });
    }
  }

  mark(id, kind, place) {
    const { layers } = this, { view } = layers;
    if (!view.at(place)) return;
    if (kind !== "launch") layers.marks.push({ key: `track ${id}`, x: view.px, y: view.py });
    const stamp = this.stamp(kind), size = stamp.width / layers.ratio;
    layers.pen.drawImage(stamp, view.px - size / 2, view.py - size / 2, size, size);
  }

  // A small canvas with a mark.
  stamp(kind) {
    const { ratio, unit, colour } = this.layers, key = `${kind} ${ratio} ${unit} ${colour[kind] || colour.ink}`;
    let stamp = this.stamps.get(key);
    if (stamp) return stamp;
    const size = 4 * unit, box = Math.ceil((2 * size + 4) * ratio), pen = (stamp = made(box, box)).getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, box / 2, box / 2);
    pen.strokeStyle = pen.fillStyle = colour[kind] || colour.ink; pen.lineWidth = 1.6 * unit;
    pen.beginPath();
    if (kind === "launch") { pen.moveTo(0, -size); pen.lineTo(size, size); pen.lineTo(-size, size); pen.fill(); }
    else if (kind === "impact") { pen.moveTo(-size, -size); pen.lineTo(size, size); pen.moveTo(-size, size); pen.lineTo(size, -size); pen.stroke(); }
    else { pen.arc(0, 0, size * 0.85, 0, 7); pen.stroke(); }
    this.stamps.set(key, stamp);
    return stamp;
  }
}
