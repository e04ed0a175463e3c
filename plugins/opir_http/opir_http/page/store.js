// What the page knows of the run, by time: detections, tracks with their trails, sensors. Bounded.
import { groundPoint, packed } from "/page/earth.js";
import { prepared } from "/page/view.js";

const MOST_HITS = 20000, MOST_TRACKS = 1500, TRAIL = 120;

const unixS = (text) => Date.parse(text) / 1000;

export class Store {
  constructor() { this.clear(); }

  clear() {
    this.hits = []; this.tracks = new Map(); this.sensors = [];
    this.firstS = Infinity; this.lastS = -Infinity; this.version = 0;
  }

  seen(timeS) {
    this.firstS = Math.min(this.firstS, timeS); this.lastS = Math.max(this.lastS, timeS);
  }

  setSensors(sensors) { this.sensors = sensors; }

  // Detections of one window, in any order.
  addDetections(events) {
    for (const event of events) {
      const place = event.latitude_deg === null
        ? groundPoint(event.sensor_position_ecef_m, event.azimuth_deg, event.elevation_deg)
        : { lat: event.latitude_deg, lon: event.longitude_deg };
      const timeS = unixS(event.timestamp);
      this.seen(timeS);
      insert(this.hits, { timeS, event, sensor: event.sensor_id, ...(place ? { lon: place.lon, lat: place.lat, place: prepared(place.lon, place.lat) } : { place: null }) });
    }
    if (this.hits.length > MOST_HITS) { this.hits.splice(0, this.hits.length - MOST_HITS); this.firstS = this.hits[0].timeS; }
  }

  // The newest estimate of a track, or an earlier one of a trail that is filled in. Estimates are kept for the time axis,
  // without what the page never shows.
  addTrack({ trail, state, burnout, ...document }) {
    const timeS = document.timeS = unixS(document.timestamp);
    document.impact_regions = (document.impact_regions || []).map((each) => ({ ...each, geometry: packed(each.geometry) }));
    this.seen(timeS);
    let track = this.tracks.get(document.track_id);
    if (!track) {
      track = { id: document.track_id, trail: [], past: [], version: 0 };
      this.tracks.set(track.id, track);
      if (this.tracks.size > MOST_TRACKS) this.tracks.delete(this.tracks.keys().next().value);
    }
    for (const [at, lat, lon, height] of trail || []) insert(track.trail, sample(unixS(at), lat, lon, height));
    if (document.latitude_deg !== null) insert(track.trail, sample(timeS, document.latitude_deg, document.longitude_deg, document.altitude_m));
    insert(track.past, { timeS, document });
    if (track.trail.length > TRAIL) thin(track.trail);
    if (track.past.length > (this.tracks.size > 200 ? 12 : 60)) thin(track.past);
    track.version += 1; this.version += 1;
  }

  // The last detections up to a time, newest first.
  latest(timeS, count) {
    const end = after(this.hits, timeS);
    return this.hits.slice(Math.max(0, end - count), end).reverse().map((hit) => hit.event);
  }

  // The document of a track at a time, or null before its first.
  documentAt(track, timeS) {
    const at = track.past.length && track.past[track.past.length - 1].timeS <= timeS ? track.past.length : after(track.past, timeS);
    return at ? track.past[at - 1].document : null;
  }
}

function sample(timeS, lat, lon, height) { return { timeS, lat, lon, height, place: prepared(lon, lat, height) }; }

// The number of entries up to a time.
export function after(entries, timeS) {
  let low = 0, high = entries.length;
  while (low < high) { const mid = (low + high) >> 1; if (entries[mid].timeS <= timeS) low = mid + 1; else high = mid; }
  return low;
}

function insert(entries, entry) {
  const last = entries.length && entries[entries.length - 1];
  if (!last || last.timeS <= entry.timeS) {
    if (last && last.timeS === entry.timeS && !("sensor" in entry)) entries[entries.length - 1] = entry; else entries.push(entry);
    return;
  }
  const at = after(entries, entry.timeS);
  if (at && entries[at - 1].timeS === entry.timeS && !("sensor" in entry)) entries[at - 1] = entry; else entries.splice(at, 0, entry);
}

// Keeps every other entry of the older three quarters.
function thin(entries) {
  const old = Math.floor(entries.length * 0.75);
  let kept = 0;
  for (let at = 0; at < entries.length; at += 1) if (at >= old || at % 2 === 0) entries[kept++] = entries[at];
  entries.length = kept;
}
