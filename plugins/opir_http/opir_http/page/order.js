// Which tracks the table and the map show, and in which order: live launches first; ended tracks and those of earlier laps
// folded; a filter by number or name.
import { byId } from "/page/panels.js";

const GONE_S = 20, LIKELY = 0.5;

export class Order {
  constructor() {
    this.words = ""; this.by = "live"; this.showsEarlier = false; this.epochS = 0; this.lapS = Infinity; this.speed = 1; this.version = 0;
    const changed = (change) => () => { change(); this.version += 1; };
    byId("filter").addEventListener("input", changed(() => { this.words = byId("filter").value.trim().toLowerCase(); }));
    byId("sort").addEventListener("change", changed(() => { this.by = byId("sort").value; }));
    byId("earlier").addEventListener("click", changed(() => {
      this.showsEarlier = !this.showsEarlier;
      byId("earlier").setAttribute("aria-pressed", String(this.showsEarlier));
    }));
  }

  // The laps of a run that repeats its scene, and its pace.
  setClock({ epoch, duration_s: durationS, lap, speed }) {
    this.epochS = Date.parse(epoch) / 1000; this.lapS = lap ? durationS : Infinity; this.speed = Math.max(1, speed || 1);
  }

  // When the lap of a time began.
  began(timeS) { return Number.isFinite(this.lapS) ? this.epochS + Math.floor((timeS - this.epochS) / this.lapS) * this.lapS : -Infinity; }

  // Whether a track has ended, or is of an earlier lap, whose last estimates are for its end.
  isEarlier(report, timeS) { return Boolean(report.end) || report.timeS <= this.began(timeS); }

  isFound(report) {
    return !this.words || `${report.track_id}` === this.words || likeliest(report).toLowerCase().includes(this.words);
  }

  isShown(report, timeS) { return this.isFound(report) && (this.showsEarlier || !this.isEarlier(report, timeS)); }

  // Lines in order; `keys` are compared one after the other, the larger first.
  sorted(lines, timeS) {
    const keys = lines.map(({ id, report }) => [...this.keys(report, timeS), id]);
    return lines.map((line, at) => at).sort((one, other) => compared(keys[one], keys[other])).map((at) => lines[at]);
  }

  keys(report, timeS) {
    const isCurrent = this.isEarlier(report, timeS) ? 0 : 1, known = (value) => (value === null || value === undefined ? -Infinity : value);
    switch (this.by) {
      case "number": return [-report.track_id];
      case "launch": return [isCurrent, known(report.probability_launch)];
      case "altitude": return [isCurrent, known(report.altitude_m)];
      case "impact": return [isCurrent, report.impact_point && report.impact_point.time ? -Date.parse(report.impact_point.time) : -Infinity];
      // A coarse order, so that lines keep still: what is seen now, then what probably is a launch, then the newest.
      default: return [isCurrent, timeS - report.timeS <= GONE_S * this.speed ? 1 : 0, isLaunch(report) ? 1 : 0];
    }
  }

  // How many tracks are folded.
  showEarlier(count) {
    const text = `Earlier: ${count}`, button = byId("earlier");
    if (button.textContent !== text) button.textContent = text;
    button.disabled = count === 0 && !this.showsEarlier;
  }
}

// A track without a probability of a launch comes from a tracker that reports launches only.
const isLaunch = (report) => report.probability_launch === null || report.probability_launch === undefined || report.probability_launch >= LIKELY;

function compared(one, other) {
  for (let at = 0; at < one.length; at += 1) if (one[at] !== other[at]) return other[at] > one[at] ? 1 : -1;
  return 0;
}

// The likeliest hypothesis; the likeliest type, if the tracker weighs no hypotheses.
export function likeliest(report) {
  if (report.likeliest === undefined) {
    const chances = report.hypotheses || report.type_probability, known = Object.keys(chances).filter((name) => chances[name] !== null);
    report.likeliest = known.length ? known.reduce((best, name) => (chances[name] > chances[best] ? name : best)) : "–";
  }
  return report.likeliest;
}
