// The time that the page shows: that of the live run, or an earlier one that is held or played; a saved run is all past.
import { byId } from "/page/panels.js";

const AHEAD_S = 1.2, BAR_MS = 250;

const text = (timeS) => (Number.isFinite(timeS) ? new Date(timeS * 1000).toISOString().slice(11, 21) : "–");

export class Player {
  // `onSeek(timeS)` is called when a saved run must be read from another time.
  constructor(store, onSeek = () => {}) {
    this.store = store; this.onSeek = onSeek; this.isLive = true; this.isPlaying = true; this.isDragging = false;
    this.timeS = NaN; this.speed = 1; this.saved = null; this.loadedS = Infinity;
    this.heardMs = 0; this.heardS = -Infinity; this.frameMs = performance.now(); this.barMs = 0;
    this.scrub = byId("scrub");
    byId("play").addEventListener("click", () => this.toggle());
    byId("live").addEventListener("click", () => this.follow());
    byId("rate").addEventListener("change", (event) => { this.speed = Number(event.target.value); });
    this.scrub.addEventListener("input", () => { this.isLive = false; this.isPlaying = this.saved !== null && this.isPlaying; this.timeS = this.baseS() + Number(this.scrub.value); this.show(true); });
    this.scrub.addEventListener("pointerdown", () => { this.isDragging = true; });
    for (const name of ["pointerup", "change", "blur"]) this.scrub.addEventListener(name, () => { this.isDragging = false; });
    this.scrub.addEventListener("change", () => this.onSeek(this.timeS));
  }

  // A saved run from one Unix time to another, s.
  setSaved(firstS, lastS) {
    this.saved = { firstS, lastS }; this.isLive = false; this.timeS = firstS; this.speed = Number(byId("rate").value);
    byId("live").hidden = true; byId("rate-label").hidden = false;
  }

  baseS() { return this.saved ? this.saved.firstS : this.store.firstS; }

  endS() { return this.saved ? this.saved.lastS : this.store.lastS; }

  toggle() {
    if (this.saved && !this.isPlaying && this.timeS >= this.saved.lastS) { this.timeS = this.saved.firstS; this.onSeek(this.timeS); }
    this.isPlaying = !this.isPlaying; this.isLive = false;
    this.show(true);
  }

  follow() { this.isLive = true; this.isPlaying = true; this.show(true); }

  // Called once in each frame; returns the time shown.
  tick() {
    const now = performance.now(), passedS = Math.min(0.25, (now - this.frameMs) / 1000);
    this.frameMs = now;
    if (this.store.lastS !== this.heardS) { this.heardS = this.store.lastS; this.heardMs = now; }
    const ahead = this.saved || !this.rated ? 0 : Math.min(AHEAD_S, (now - this.heardMs) / 1000) * this.speed;
    if (this.isLive) this.timeS = Math.max(this.heardS + ahead, this.timeS - 5 || -Infinity);
    else if (this.isPlaying && !this.isDragging) this.timeS = Math.min(this.timeS + passedS * this.speed, this.endS(), this.loadedS);
    if (!this.isLive && this.isPlaying && !this.saved && this.timeS >= this.endS()) this.isLive = true;
    if (this.saved && this.isPlaying && this.timeS >= this.saved.lastS) this.isPlaying = false;
    this.show(false);
    return this.timeS;
  }

  // Pace of the live run: scene time per real time, null if unpaced.
  setPace(speed, isRunning) { if (!this.saved) { this.rated = isRunning && speed !== null; this.speed = speed || 20; } }

  show(isNow) {
    const now = performance.now();
    if (!isNow && now - this.barMs < BAR_MS) return;
    this.barMs = now;
    const first = this.baseS(), last = this.endS();
    byId("play").textContent = this.isPlaying ? "Pause" : "Play";
    byId("live").setAttribute("aria-pressed", String(this.isLive));
    if (!Number.isFinite(first) || !Number.isFinite(last)) return;
    byId("from").textContent = text(first).slice(0, 8); byId("until").textContent = text(last).slice(0, 8);
    byId("shown").textContent = `${text(this.timeS)} Z`;
    this.scrub.max = Math.max(0, last - first).toFixed(1);
    if (!this.isDragging) this.scrub.value = this.timeS - first;
    this.scrub.setAttribute("aria-valuetext", `${text(this.timeS)} UTC`);
  }
}
