// The page: shows status, detections and tracks of the stream, and sends launches of the form.
import { WorldMap } from "/page/map.js";
import { setState, showLatest, showStatus, showTracks, Timeline } from "/page/panels.js";
import { ask, follow } from "/page/service.js";

const map = new WorldMap(document.getElementById("map"));
// For tests: the content of the map is in no element.
window.opirMap = map;
const timeline = new Timeline(document.getElementById("timeline"));

function status(data) {
  showStatus(data);
  map.setSensors(data.sensors);
  timeline.setSensors(data.sensors);
}

const on = {
  status,
  detections(data) {
    data.detections.forEach((event) => map.hit(event));
    timeline.add(data.detections, data.time_s, data.count / data.detections.length);
    showLatest(data.detections);
  },
  tracks(data) { data.tracks.forEach((track) => map.setTrack(track)); showTracks(map.tracks); },
  end() { setState("stopped"); },
  lost() { setState("lost"); },
};

const form = document.getElementById("launch"), answer = document.getElementById("answer");
form.addEventListener("submit", async (event) => {
  event.preventDefault();
  const given = new FormData(form), number = (name) => Number(given.get(name));
  const invalid = [...form.querySelectorAll("input")].find((input) => !input.checkValidity());
  if (invalid) { show(`${invalid.closest("fieldset").querySelector("legend").textContent}, ${invalid.parentElement.firstChild.textContent.trim()} ${invalid.validationMessage}`, true); invalid.focus(); return; }
  const button = form.querySelector("button");
  button.disabled = true;
  try {
    const body = { type: given.get("type"), launch: { lat_deg: number("launch_lat"), lon_deg: number("launch_lon") }, aim: { lat_deg: number("aim_lat"), lon_deg: number("aim_lon") } };
    const key = `${Date.now()}-${Math.random().toString(36).slice(2)}`;
    const response = await ask("/trigger", { method: "POST", headers: { "Content-Type": "application/json", "Idempotency-Key": key }, body: JSON.stringify(body) });
    const result = await response.json();
    if (response.ok) show(`${result.id} launches at ${result.timestamp.slice(11, 22)} Z`, false);
    else show((result.errors || []).map((error) => `${error.path}: ${error.message}`).join("; ") || result.detail, true);
  } catch { show("The service cannot be reached", true); } finally { button.disabled = false; }
});

function show(text, isBad) { answer.textContent = text; answer.className = isBad ? "bad" : ""; }

ask("/status").then((response) => response.json()).then(status).catch(() => setState("lost"));
ask("/tracks").then((response) => response.json()).then(on.tracks).catch(() => setState("lost"));
follow("/stream?view=brief", (event, data) => on[event] && on[event](data));
