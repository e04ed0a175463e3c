// The panels around the map. Text is inserted as text, never as markup.
const whole = new Intl.NumberFormat("en");
const byId = (id) => document.getElementById(id);

export function showStatus(status) {
  const { clock, counts } = status;
  byId("scene").textContent = status.scene;
  setState(status.state);
  byId("clock").textContent = clock.timestamp.replace("T", " ").slice(0, 21) + " Z";
  const speed = clock.speed === null ? "unpaced" : `${clock.speed}×`;
  byId("pace").textContent = clock.late_s > 0.5 ? `${speed}, ${clock.late_s.toFixed(1)} s late` : speed;
  byId("detections").textContent = whole.format(counts.detections);
  byId("targets").textContent = `${counts.targets} of ${counts.targets_launched}`;
  byId("tracks").textContent = whole.format(counts.tracks);
  rows("sink-rows", status.sinks.map((sink) => [sink.name, sink.error || sink.state, whole.format(sink.delivered), whole.format(sink.lag)]), status.sinks.map((sink) => sink.state === "failed"), "None");
}

export function setState(name) {
  const state = byId("state");
  if (state.textContent !== name) { state.textContent = name; state.className = name; }
}

export function showTracks(tracks) {
  const newest = [...tracks.values()].sort((one, other) => other.at - one.at).slice(0, 30);
  rows("track-rows", newest.map((track) => [`${track.track_id}`, position(track.launch_point), position(track.impact_point), semiMajorKm(track.impact_point)]), [], "None yet");
}

const latest = [];
export function showLatest(events) {
  latest.unshift(...events.slice(-12).reverse());
  latest.length = Math.min(latest.length, 12);
  rows("latest", latest.map((event) => [event.timestamp.slice(11, 22), event.sensor_id, event.target_type, event.confidence.toFixed(2)]), [], "None yet");
}

function position(point) {
  if (!point) return "–";
  const lat = `${Math.abs(point.lat_deg).toFixed(1)}° ${point.lat_deg < 0 ? "S" : "N"}`;
  return `${lat}, ${Math.abs(point.lon_deg).toFixed(1)}° ${point.lon_deg < 0 ? "W" : "E"}`;
}

// The semi-major axis of the 95 % ellipse, km.
function semiMajorKm(point) {
  return point && point.ellipse ? whole.format(Math.round(point.ellipse.semi_major_m / 1000)) : "–";
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

// Detections per sensor and second of scene time, for two minutes.
const SECONDS = 120;
export class Timeline {
  constructor(element) { this.element = element; this.bars = new Map(); this.now = 0; }

  setSensors(sensors) {
    for (const sensor of sensors) {
      if (!this.bars.has(sensor.sensor_id)) {
        const name = document.createElement("b"), bar = document.createElement("canvas"), total = document.createElement("span");
        name.textContent = sensor.sensor_id; bar.className = "bar"; bar.setAttribute("aria-hidden", "true");
        this.element.append(name, bar, total);
        this.bars.set(sensor.sensor_id, { bar, total, seconds: new Map() });
      }
      this.bars.get(sensor.sensor_id).total.textContent = whole.format(sensor.detections);
    }
    this.draw();
  }

  add(events, timeS, weight) {
    this.now = timeS;
    for (const event of events) {
      const bar = this.bars.get(event.sensor_id), second = Math.floor(timeS);
      if (bar) bar.seconds.set(second, (bar.seconds.get(second) || 0) + weight);
    }
  }

  draw() {
    const colour = getComputedStyle(document.documentElement).getPropertyValue("--hit").trim();
    for (const { bar, seconds } of this.bars.values()) {
      const width = bar.clientWidth, height = bar.clientHeight, pen = bar.getContext("2d");
      bar.width = width; bar.height = height; pen.fillStyle = colour;
      for (const [second, count] of seconds) {
        const age = this.now - second;
        if (age > SECONDS) { seconds.delete(second); continue; }
        pen.globalAlpha = Math.min(1, 0.35 + count / 30);
        pen.fillRect(width - (age / SECONDS) * width, 1, Math.max(width / SECONDS, 1), height - 2);
      }
    }
  }
}
