// The page: shows a running scene, or a saved run, at the time of its time axis, and sends launches of the form.
import { Alerts } from "/page/alerts.js";
import { Tasks } from "/page/fields.js";
import { LaunchForm } from "/page/form.js";
import { WorldMap } from "/page/map.js";
import { likeliest, Order } from "/page/order.js";
import { byId, setState, showLatest, showStatus, Timeline } from "/page/panels.js";
import { drawPicked } from "/page/picked.js";
import { Player } from "/page/player.js";
import { Saved } from "/page/saved.js";
import { SensorTable } from "/page/sensors.js";
import { ask, follow } from "/page/service.js";
import { Store } from "/page/store.js";
import { detailsOf, showDetails, TrackTable } from "/page/table.js";

const PAGE = 1000, PAGES = 4, TRACKS = 300, PAST_S = 120, COUNTS_MS = 1000, NEWS_MS = 5000;

const store = new Store(), timeline = new Timeline(byId("timeline"));
let form = null;
const player = new Player(store, (timeS) => saved.seek(timeS));
const saved = new Saved(store, player, timeline);
const order = new Order();
const map = new WorldMap(byId("map"), store, order, {
  select,
  place: (lon, lat) => form.place(lon, lat),
  time: () => ({ timeS: frame(), speed: player.speed }),
  point: () => { tasks.show(reportAt(frame()), player.timeS); tasks.list.focus(); },
});
form = new LaunchForm(map);
const table = new TrackTable(byId("track-rows"), store, order, (key) => { select(key); showOnMap(key); });
const sensors = new SensorTable((key) => select(key));
const alerts = new Alerts((key) => { select(key); showOnMap(key); });
const tasks = new Tasks(store, order, (key) => select(key));
// For tests: the content of the canvas is in no element.
window.opirMap = map; window.opirStore = store; window.opirPlayer = player; window.opirAlerts = alerts;

let detailsMs = 0, newsMs = 0, announced = 0;
function frame() {
  const timeS = player.tick(), now = performance.now();
  table.update(timeS);
  saved.update();
  if (now - detailsMs > 400) { detailsMs = now; showDetails(detailsOf(store, map.selected, timeS)); timeline.draw(timeS); sensors.show(store.sensors); showLeft(map.layers.left); showPlots(timeS); tasks.show(reportAt(timeS), timeS); showLatest(store.latest(timeS, 12)); if (saved.range) showSaved(timeS); }
  if (now - newsMs > NEWS_MS) { newsMs = now; announce(); }
  return timeS;
}

function selectedTrack() { const key = map.selected; return key && key.startsWith("track ") ? store.tracks.get(Number(key.slice(6))) : null; }

// The selected track's estimate at a time of a run that goes on, for a task; else null.
function reportAt(timeS) { const track = saved.range ? null : selectedTrack(); return track ? store.documentAt(track, timeS) : null; }

function showPlots(timeS) {
  if (map.layers.colour) drawPicked(selectedTrack(), timeS, map.layers);
}

// How many tracks the map shows without their regions.
function showLeft({ drawn, all }) {
  byId("left").hidden = drawn === all;
  byId("left").textContent = `areas of ${drawn} of ${all} tracks: the selected, the latest, the largest; the others' impact points are counted`;
}

function showSaved(timeS) {
  byId("clock").textContent = `${new Date(timeS * 1000).toISOString().replace("T", " ").slice(0, 21)} Z`;
  byId("pace").textContent = player.isPlaying ? `${player.speed}×` : "held";
}

function select(key) {
  map.selected = key;
  table.select(key);
  detailsMs = 0;
}

// Turns the map to a track, so that a row leads to its mark.
function showOnMap(key) {
  const track = store.tracks.get(Number(key.slice(6))), last = track && track.trail[track.trail.length - 1];
  if (last && !map.xy(last.lon, last.lat)) map.lookAt(last.lon, last.lat);
}

// New tracks, for a screen reader; at most one message each five seconds.
function announce() {
  const fresh = [...store.tracks.values()].slice(announced);
  announced = store.tracks.size;
  if (!fresh.length) return;
  const reports = fresh.map((track) => store.documentAt(track, Infinity)).filter(Boolean);
  byId("news").textContent = fresh.length > 3 ? `${fresh.length} new tracks` : reports.map((report) => `New track ${report.track_id}, ${likeliest(report)}`).join("; ");
}

function status(data) {
  showStatus(data);
  if (!data.replay) store.setSensors(data.sensors);
  timeline.setSensors(data.sensors);
  order.setClock(data.clock);
  player.setPace(data.clock.speed, data.state === "running");
  store.seen(Date.parse(data.clock.timestamp) / 1000);
}

const on = {
  status(data) { status(data); alerts.health(data.health, data.clock.timestamp); },
  detections(data) { store.addDetections(data.detections); },
  tracks(data) { data.tracks.forEach((track) => store.addTrack(track)); alerts.tracks(data.tracks); },
  end() { setState("stopped"); },
  lost() { setState("lost"); alerts.health(null); },
};

const got = async (path) => { const answer = await ask(path); if (!answer.ok) throw new Error(path); return answer.json(); };

// What happened before the page was opened: detections of the last two minutes, the tracks updated last
// with their trails.
async function past(data) {
  const since = new Date(Math.max(0, Date.parse(data.clock.timestamp) - PAST_S * 1000)).toISOString();
  (await got(`/tracks?limit=${TRACKS}&trail=true`)).tracks.forEach((track) => store.addTrack(track));
  let after = "";
  for (let page = 0; page < PAGES; page += 1) {
    const found = await got(`/detections?limit=${PAGE}&since=${since}${after}`);
    store.addDetections(found.detections.reverse());
    if (!found.next) break;
    after = `&after=${found.next}`;
  }
}

async function counts() {
  try {
    const found = await got("/activity");
    timeline.set(found.first_s, found.sensors);
  } catch { /* the stream reports a lost service */ }
  setTimeout(counts, COUNTS_MS);
}

for (const kind of ["map", "globe"]) {
  byId(`to-${kind}`).addEventListener("click", () => {
    map.show(kind);
    for (const each of ["map", "globe"]) byId(`to-${each}`).setAttribute("aria-pressed", String(each === kind));
  });
}
byId("zoom-in").addEventListener("click", () => map.zoomBy(1.6));
byId("zoom-out").addEventListener("click", () => map.zoomBy(1 / 1.6));
byId("to-coverage").addEventListener("click", () => {
  const isOn = map.layers.showsCoverage = !map.layers.showsCoverage;
  map.layers.shadeVersion = null;
  byId("to-coverage").setAttribute("aria-pressed", String(isOn));
  document.querySelector(".k-cover").hidden = !isOn;
});
byId("show-all").addEventListener("click", () => map.reset());

async function start() {
  const data = await got("/status");
  status(data);
  if (data.replay) { byId("launch-panel").hidden = byId("sinks-panel").hidden = byId("alerts-panel").hidden = true; await saved.open(data); return; }
  follow("/stream?view=brief", (event, body) => on[event] && on[event](body));
  counts();
  await past(data);
}

start().catch(() => setState("lost"));
