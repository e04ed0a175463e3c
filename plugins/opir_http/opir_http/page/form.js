// The launch form: its places are typed or chosen on the map.
import { byId } from "/page/panels.js";
import { ask } from "/page/service.js";

export class LaunchForm {
  constructor(map) {
    this.map = map; this.form = byId("launch"); this.answer = byId("answer"); this.next = null;
    this.form.addEventListener("submit", (event) => { event.preventDefault(); this.send(); });
    this.form.addEventListener("input", () => this.mark());
    byId("choose").addEventListener("click", () => this.choose(this.next ? null : "launch"));
  }

  // Lets the next clicks on the map set the launch point, then the aim point.
  choose(name) {
    this.next = name;
    this.map.isChoosing = name !== null;
    this.map.canvas.classList.toggle("choosing", name !== null);
    byId("choose").setAttribute("aria-pressed", String(name !== null));
    if (name) this.show(name === "launch" ? "Click the launch point on the map (keyboard: move it to the centre, Enter)" : "Now the aim point", false);
    this.mark();
  }

  place(lon, lat) {
    const digits = (value) => String(Math.round(value * 1e4) / 1e4);
    this.form.elements[`${this.next}_lat`].value = digits(lat);
    this.form.elements[`${this.next}_lon`].value = digits(lon);
    const isLast = this.next === "aim";
    this.choose(isLast ? null : "aim");
    this.mark();
    if (isLast) { this.show("Both places are set: press Launch", false); this.form.querySelector("button[type=submit]").focus(); }
  }

  mark() {
    const value = (name) => Number(this.form.elements[name].value);
    this.map.places = ["launch", "aim"].map((name) => ({ name, lat: value(`${name}_lat`), lon: value(`${name}_lon`) }));
  }

  async send() {
    const form = this.form, given = new FormData(form), number = (name) => Number(given.get(name));
    const invalid = [...form.querySelectorAll("input")].find((input) => !input.checkValidity());
    if (invalid) { this.show(`${invalid.closest("fieldset").querySelector("legend").textContent}, ${invalid.parentElement.firstChild.textContent.trim()} ${invalid.validationMessage}`, true); invalid.focus(); return; }
    const button = form.querySelector("button[type=submit]");
    button.disabled = true;
    try {
      const body = { type: given.get("type"), launch: { lat_deg: number("launch_lat"), lon_deg: number("launch_lon") }, aim: { lat_deg: number("aim_lat"), lon_deg: number("aim_lon") } };
      const key = `${Date.now()}-${Math.random().toString(36).slice(2)}`;
      const response = await ask("/trigger", { method: "POST", headers: { "Content-Type": "application/json", "Idempotency-Key": key }, body: JSON.stringify(body) });
      const result = await response.json();
      if (response.ok) { this.show(`${result.id} launches at ${result.timestamp.slice(11, 22)} Z`, false); this.map.places = []; }
      else this.show((result.errors || []).map((error) => `${error.path}: ${error.message}`).join("; ") || result.detail, true);
    } catch { this.show("The service cannot be reached", true); } finally { button.disabled = false; }
  }

  show(text, isBad) { this.answer.textContent = text; this.answer.className = isBad ? "bad" : ""; }
}
