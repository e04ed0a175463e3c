// The page: status and detections come by the stream; a launch goes out by the form.
import { WorldMap } from "/page/map.js";
import { setState, showLatest, showStatus, showTracks, Timeline } from "/page/panels.js";
import { ask, follow } from "/page/service.js";

const map = new WorldMap(document.getElementById("map"));
// For who looks at the page from a script: what the map shows is in no element.
window.opirMap = map;
const timeline = new Timeline(document.getElementById("timeline"));

function status(told) {
  showStatus(told);
  map.setSensors(told.sensors);
  timeline.setSensors(told.sensors);
}

const on = {
  status,
  detections(told) {
    told.detections.forEach((event) => map.hit(event));
    timeline.add(told.detections, told.time_s, told.count / told.detections.length);
    showLatest(told.detections);
  },
  tracks(told) { told.tracks.forEach((track) => map.setTrack(track)); showTracks(map.tracks); },
  end() { setState("stopped"); },
  lost() { setState("lost"); },
};

const form = document.getElementById("launch"), answer = document.getElementById("answer");
form.addEventListener("submit", async (event) => {
  event.preventDefault();
  const given = new FormData(form), number = (name) => Number(given.get(name));
  const wrong = [...form.querySelectorAll("input")].find((input) => !input.checkValidity());
  if (wrong) { say(`${wrong.closest("fieldset").querySelector("legend").textContent}, ${wrong.parentElement.firstChild.textContent.trim()} ${wrong.validationMessage}`, true); wrong.focus(); return; }
  const button = form.querySelector("button");
  button.disabled = true;
  try {
    const body = { type: given.get("type"), launch: { lat_deg: number("launch_lat"), lon_deg: number("launch_lon") }, aim: { lat_deg: number("aim_lat"), lon_deg: number("aim_lon") } };
    const key = `${Date.now()}-${Math.random().toString(36).slice(2)}`;
    const told = await ask("/trigger", { method: "POST", headers: { "Content-Type": "application/json", "Idempotency-Key": key }, body: JSON.stringify(body) });
    const result = await told.json();
    if (told.ok) say(`${result.id} goes up at ${result.timestamp.slice(11, 22)} Z`, false);
    else say((result.errors || []).map((error) => `${error.path}: ${error.message}`).join("; ") || result.detail, true);
  } catch { say("The service cannot be reached", true); } finally { button.disabled = false; }
});

function say(words, isBad) { answer.textContent = words; answer.className = isBad ? "bad" : ""; }

ask("/status").then((told) => told.json()).then(status).catch(() => setState("lost"));
ask("/tracks").then((told) => told.json()).then(on.tracks).catch(() => setState("lost"));
follow("/stream?view=brief", (event, data) => on[event] && on[event](data));
