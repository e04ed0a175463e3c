// Reads a service with the types that openapi-typescript makes of its document: node reads.js http://127.0.0.1:8000
import type { components, paths } from "./opir.js";

type Answer<Path extends "/status" | "/tracks"> =
  paths[Path]["get"]["responses"][200]["content"]["application/json"];
type Track = components["schemas"]["Track"];
type StreamEvent = components["schemas"]["StreamEvent"];

async function get<Path extends "/status" | "/tracks">(path: Path): Promise<Answer<Path>> {
  const answer = await fetch(service + path);
  if (!answer.ok) throw new Error(`${path}: ${answer.status}`);
  return (await answer.json()) as Answer<Path>;
}

function place(track: Track): string {
  const { latitude_deg: latitude, longitude_deg: longitude } = track;
  return latitude === null || longitude === null ? "nowhere" : `${latitude.toFixed(1)} ${longitude.toFixed(1)}`;
}

function size(event: StreamEvent): number {
  return event.event === "detections" ? event.data.count : 0;
}

const service: string = process.argv[2] ?? "";
const status = await get("/status");
const { tracks } = await get("/tracks");
const frame: StreamEvent = { event: "detections", id: 1, data: { cycle: 1, time_s: 1.0, count: 0, detections: [] } };
console.log(JSON.stringify({
  state: status.state,
  launched: status.counts.targets_launched,
  places: tracks.map(place),
  size: size(frame),
}));
