// The map: draws a frame whenever the browser shows one; pointer and keys turn, move and zoom it and pick from it.
import { Layers } from "/page/layers.js";
import { prepared, View } from "/page/view.js";

const NEAR_PX = 16, REST_MS = 250, STEP_PX = 60, ZOOM = 1.4;

export class WorldMap {
  // `on` has `select(key)`, `place(lon, lat)`, `point()` and `time()`: the scene's time shown, its speed and whether it runs.
  constructor(canvas, store, order, on) {
    this.canvas = canvas; this.store = store; this.order = order; this.on = on;
    this.view = new View(); this.layers = new Layers(canvas, this.view);
    this.selected = null; this.places = []; this.isChoosing = false; this.hasKeys = false; this.movedAt = -Infinity;
    this.pointers = new Map(); this.isCentred = false; this.frames = 0;
    this.calm = matchMedia("(prefers-reduced-motion: reduce)");
    new ResizeObserver(() => this.resize()).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.resize());
    this.listen();
    requestAnimationFrame(() => this.frame());
  }

  get drawn() { return this.layers.drawn; }

  resize() {
    const box = this.canvas.getBoundingClientRect();
    if (box.width && box.height) this.layers.resize(box.width, box.height);
  }

  // Where a place is on the canvas, for tests: the content of the canvas is in no element.
  xy(lon, lat) { return this.view.at(prepared(lon, lat)) ? [this.view.px, this.view.py] : null; }

  show(kind) {
    const hit = this.store.hits.findLast((each) => each.place);
    if (kind === "globe" && hit && this.view.zoom <= 1) this.view.lookAt(hit.lon, Math.max(-55, Math.min(55, hit.lat)));
    this.view.show(kind); this.moved();
  }

  // The first detection is in view on the globe, and not at the map's edge.
  centre() {
    const hit = this.store.hits.findLast((each) => each.place);
    if (this.isCentred || !hit) return;
    this.isCentred = true;
    this.view.lookAt(hit.lon, this.view.kind === "globe" ? hit.lat : 0);
    this.moved();
  }

  lookAt(lon, lat) { this.isCentred = true; this.view.lookAt(lon, this.view.kind === "globe" ? lat : this.view.lat); this.moved(); }

  zoomBy(factor, x, y) { this.isCentred = true; this.view.zoomBy(factor, x, y); this.moved(); }

  reset() { this.view.reset(); this.moved(); }

  moved() { this.movedAt = performance.now(); }

  frame() {
    requestAnimationFrame(() => this.frame());
    if (document.hidden || !this.layers.colour || !this.view.width) return;
    this.centre();
    const { timeS, speed } = this.on.time();
    const isMoving = performance.now() - this.movedAt < REST_MS || this.pointers.size > 0;
    this.layers.draw(this.store, timeS, { speed, selected: this.selected, isMoving, isCalm: this.calm.matches, crosshair: this.hasKeys, places: this.places, order: this.order });
    this.frames += 1;
  }

  listen() {
    const canvas = this.canvas, at = (event) => { const box = canvas.getBoundingClientRect(); return { x: event.clientX - box.left, y: event.clientY - box.top }; };
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      const { x, y } = at(event);
      this.zoomBy(2 ** (-event.deltaY * (event.deltaMode ? 0.05 : 0.002)), x, y);
    }, { passive: false });
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      this.pointers.set(event.pointerId, { ...at(event), from: at(event) });
      this.hasKeys = false;
    });
    canvas.addEventListener("pointermove", (event) => this.drag(event.pointerId, at(event)));
    canvas.addEventListener("pointerup", (event) => {
      const pointer = this.pointers.get(event.pointerId), { x, y } = at(event);
      this.pointers.delete(event.pointerId);
      if (pointer && !pointer.hasMoved) this.click(x, y);
      this.moved();
    });
    canvas.addEventListener("pointercancel", (event) => this.pointers.delete(event.pointerId));
    canvas.addEventListener("keydown", (event) => { if (!event.ctrlKey && !event.metaKey && !event.altKey && this.key(event.key)) { event.preventDefault(); this.hasKeys = true; } });
    canvas.addEventListener("blur", () => { this.hasKeys = false; });
  }

  drag(id, { x, y }) {
    const pointer = this.pointers.get(id);
    if (!pointer) return;
    if (!pointer.hasMoved && Math.hypot(x - pointer.from.x, y - pointer.from.y) < 5) return;
    pointer.hasMoved = true; this.isCentred = true;
    const other = [...this.pointers.entries()].find(([each]) => each !== id);
    if (other) {
      const still = other[1], before = Math.hypot(pointer.x - still.x, pointer.y - still.y), now = Math.hypot(x - still.x, y - still.y);
      if (before > 5 && now > 5) this.view.zoomBy(now / before, (x + still.x) / 2, (y + still.y) / 2);
    } else this.view.pan(x - pointer.x, y - pointer.y);
    pointer.x = x; pointer.y = y;
    this.moved();
  }

  // Returns whether the key has an effect here.
  key(name) {
    const pans = { ArrowLeft: [STEP_PX, 0], ArrowRight: [-STEP_PX, 0], ArrowUp: [0, STEP_PX], ArrowDown: [0, -STEP_PX] };
    if (pans[name]) { this.isCentred = true; this.view.pan(...pans[name]); this.moved(); }
    else if (name === "+" || name === "=") this.zoomBy(ZOOM);
    else if (name === "-" || name === "_") this.zoomBy(1 / ZOOM);
    else if (name === "0" || name === "Home") this.reset();
    else if (name === "Enter" || name === " ") this.click(this.view.midX, this.view.midY, 60);
    else if (name === "Escape") this.on.select(null);
    else if (name === "p" || name === "P") this.on.point();
    else return false;
    return true;
  }

  // Chooses a place for the form, or what is nearest.
  click(x, y, near = NEAR_PX) {
    if (this.isChoosing) {
      const place = this.view.placeAt(x, y);
      if (place) this.on.place(place[0], place[1]);
      return;
    }
    let found = null, least = near;
    for (const mark of this.layers.marks || []) {
      const distance = Math.hypot(mark.x - x, mark.y - y);
      if (distance < least) { least = distance; found = mark.key; }
    }
    this.on.select(found);
  }
}
