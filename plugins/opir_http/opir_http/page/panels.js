// The panels around the map. Text is inserted as text, never as markup.
export const whole = new Intl.NumberFormat("en");
export const byId = (id) => document.getElementById(id);

export function showStatus(status) {
  const { clock, counts } = status;
  byId("scene").textContent = status.scene;
  setState(status.state);
  byId("clock").textContent = clock.timestamp.replace("T", " ").slice(0, 21) + " Z";
  const speed = clock.speed === null ? "unpaced" : `${clock.speed}×`;
  byId("pace").textContent = clock.late_s > 0.5 ? `${speed}, ${clock.late_s.toFixed(1)} s late` : speed;
  byId("detections").textContent = whole.format(counts.detections);
  byId("targets").textContent = status.replay ? `${counts.targets_launched}` : `${counts.targets} of ${counts.targets_launched}`;
  byId("tracks").textContent = whole.format(counts.tracks);
  rows("sink-rows", status.sinks.map((sink) => [sink.name, sink.error || sink.state, whole.format(sink.delivered), whole.format(sink.lag)]), status.sinks.map((sink) => sink.state === "failed"), "None");
}

export function setState(name) {
  const state = byId("state");
  if (state.textContent !== name) { state.textContent = name; state.className = name; }
}

// Detections, newest first.
export function showLatest(events) {
  rows("latest", events.map((event) => [event.timestamp.slice(11, 22), event.sensor_id, event.target_type, event.confidence === null ? "–" : event.confidence.toFixed(2)]), [], "None yet");
}

export function position(point) {
  if (!point) return "–";
  const lat = `${Math.abs(point.lat_deg).toFixed(1)}° ${point.lat_deg < 0 ? "S" : "N"}`;
  return `${lat}, ${Math.abs(point.lon_deg).toFixed(1)}° ${point.lon_deg < 0 ? "W" : "E"}`;
}

function rows(id, table, bad, none) {
  const lines = table.map((cells, row) => {
    const line = document.createElement("tr");
    cells.forEach((text) => { const cell = line.insertCell(); cell.textContent = text; if (bad[row]) cell.className = "bad"; });
    return line;
  });
  if (!lines.length) { const line = document.createElement("tr"); const cell = line.insertCell(); cell.colSpan = 4; cell.textContent = none; lines.push(line); }
  byId(id).replaceChildren(...lines);
}

// Detections per sensor and second of scene time, for the two minutes before the time shown; their sums are exact.
const SECONDS = 120, KEPT_S = 1200;
export class Timeline {
  constructor(element) { this.element = element; this.bars = new Map(); }

  setSensors(sensors) {
    for (const { sensor_id: id } of sensors) {
      if (this.bars.has(id)) continue;
      const name = document.createElement("b"), bar = document.createElement("canvas"), total = document.createElement("span");
      name.textContent = id; bar.className = "bar"; bar.setAttribute("aria-hidden", "true"); total.textContent = "0";
      this.element.append(name, bar, total);
      this.bars.set(id, { bar, total, seconds: new Map() });
    }
  }

  // The counts of seconds replace those known: `first` is a Unix time, s, `counts` has a list of seconds for each sensor.
  set(firstS, counts) {
    for (const [id, list] of Object.entries(counts)) {
      const row = this.bars.get(id);
      if (!row) continue;
      list.forEach((count, at) => { if (count) row.seconds.set(firstS + at, count); });
      for (const second of row.seconds.keys()) if (second < firstS - KEPT_S) row.seconds.delete(second); else break;
    }
  }

  draw(nowS) {
    const colour = getComputedStyle(document.documentElement).getPropertyValue("--hit").trim();
    for (const { bar, total, seconds } of this.bars.values()) {
      const width = bar.clientWidth, height = bar.clientHeight, pen = bar.getContext("2d");
      bar.width = width; bar.height = height; pen.fillStyle = colour;
      let sum = 0;
      for (const [second, count] of seconds) {
        const age = nowS - second;
        if (age < 0 || age > SECONDS) continue;
        sum += count;
        pen.globalAlpha = Math.min(1, 0.35 + count / 30);
        pen.fillRect(width - (age / SECONDS) * width, 1, Math.max(width / SECONDS, 1), height - 2);
      }
      const text = whole.format(sum);
      if (total.textContent !== text) total.textContent = text;
    }
  }
}
