// Alerts for an operator: a probable launch, a service that is not ready; as words, a sound, a notification. All are off
// until they are chosen, and the choice is kept in this browser. Nothing is fetched.
import { byId } from "/page/panels.js";
import { likeliest } from "/page/order.js";

const KEY = "opir-alerts", OFF = { launch: false, probability: 0.9, health: false, sound: false, notify: false };
const LAUNCH_HZ = 880, HEALTH_HZ = 440, TONE_S = 0.18, TONES = 3, MOST_NAMED = 3, MOST_TOLD = 20000;

export class Alerts {
  constructor(onPick) {
    this.onPick = onPick; this.told = new Set(); this.isReady = true; this.lastAt = ""; this.sounds = null;
    this.chosen = { ...OFF, ...stored() };
    for (const name of Object.keys(OFF)) {
      const input = byId(`alert-${name}`), isSwitch = input.type === "checkbox";
      if (isSwitch) input.checked = this.chosen[name]; else input.value = this.chosen[name];
      input.addEventListener("change", () => {
        if (!isSwitch && !input.validity.valid) input.value = this.chosen[name];
        this.chosen[name] = isSwitch ? input.checked : Number(input.value);
        localStorage.setItem(KEY, JSON.stringify(this.chosen));
        this.allow(name);
      });
    }
    byId("alert-pick").addEventListener("click", () => this.onPick(byId("alert-pick").dataset.key));
    // A browser plays no sound before the first click or key.
    for (const kind of ["pointerdown", "keydown"]) addEventListener(kind, () => { if (this.chosen.sound) this.player().resume(); });
  }

  // Asks the browser for what was just switched on, and says if it refuses.
  async allow(name) {
    if (name === "sound" && this.chosen.sound) this.play(LAUNCH_HZ);
    if (name !== "notify" || !this.chosen.notify) return;
    const answer = "Notification" in window ? await Notification.requestPermission() : "denied";
    byId("alert-hint").textContent = answer === "granted" ? "" : "The browser refuses notifications of this page.";
  }

  // Estimates as they arrive: each track alerts once. One without P(launch) is of a tracker that reports launches only.
  tracks(reports) {
    if (!this.chosen.launch) return;
    const fresh = reports.filter((report) => !report.end && (report.probability_launch ?? 1) >= this.chosen.probability && !this.told.has(report.track_id));
    if (!fresh.length) return;
    fresh.forEach((report) => this.told.add(report.track_id));
    while (this.told.size > MOST_TOLD) this.told.delete(this.told.values().next().value);
    const words = fresh.length > MOST_NAMED ? `${fresh.length} probable launches` : fresh.map((report) => `Track ${report.track_id}: launch, ${likeliest(report)}`).join("; ");
    this.say(words, fresh[fresh.length - 1].timestamp, LAUNCH_HZ, `track ${fresh[fresh.length - 1].track_id}`);
  }

  // The health of each status; null when the service is lost. It alerts when it becomes unready.
  health(health, at = this.lastAt) {
    this.lastAt = at;
    const isReady = Boolean(health && health.ready), was = this.isReady;
    this.isReady = isReady;
    if (this.chosen.health && was && !isReady) this.say(`Not ready: ${health ? health.reasons.join("; ") : "the service does not answer"}`, at, HEALTH_HZ, "");
  }

  say(words, at, hertz, key) {
    const pick = byId("alert-pick");
    byId("alert-last").textContent = `${at.slice(11, 19)} Z  ${words}`;
    pick.hidden = !key; pick.dataset.key = key;
    if (this.chosen.sound) this.play(hertz);
    if (this.chosen.notify && "Notification" in window && Notification.permission === "granted") new Notification("opir", { body: words, icon: "/page/icon.svg" });
  }

  player() { return this.sounds ||= new AudioContext(); }

  play(hertz) {
    const player = this.player();
    player.resume();
    for (let tone = 0; tone < TONES; tone += 1) {
      const source = player.createOscillator(), volume = player.createGain(), startS = player.currentTime + 2 * tone * TONE_S;
      source.frequency.value = hertz; volume.gain.value = 0.2;
      source.connect(volume).connect(player.destination);
      source.start(startS); source.stop(startS + TONE_S);
    }
  }
}

function stored() {
  try { return JSON.parse(localStorage.getItem(KEY)) || {}; } catch { return {}; }
}
