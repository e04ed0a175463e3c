// A saved run (`opir view`): reads it in pieces ahead of the time shown.
import { ask } from "/page/service.js";

const BACK_S = 600, BACK_STEP_S = 20, PIECE_S = 10;

const utc = (timeS) => new Date(timeS * 1000).toISOString();

export class Saved {
  constructor(store, player, timeline) { this.store = store; this.player = player; this.timeline = timeline; this.range = null; this.sensors = []; this.isReading = false; this.turn = 0; }

  async open(data) {
    this.range = { firstS: Date.parse(data.replay.since) / 1000, lastS: Date.parse(data.replay.until) / 1000 };
    this.player.setSaved(this.range.firstS, this.range.lastS);
    await this.seek(this.range.firstS);
  }

  // Forgets what is read and reads what leads to a time.
  async seek(timeS) {
    if (!this.range) return;
    const turn = this.turn += 1, { firstS } = this.range;
    this.player.loadedS = timeS;
    this.isReading = true;
    const back = timeS > firstS ? await this.read(Math.max(firstS, timeS - BACK_S), timeS, BACK_STEP_S) : null;
    if (turn !== this.turn) return;
    this.store.clear();
    this.sensors = [];
    if (back) this.take(back);
    this.isReading = false;
    this.update();
  }

  // Called in each frame: reads the next piece when it is near, and shows the satellites of the time.
  update() {
    if (!this.range) return;
    const { player, range } = this, piece = PIECE_S * Math.max(1, player.speed / 5);
    const now = this.sensors.filter((each) => each.timeS <= player.timeS + 0.5).pop() || this.sensors[0];
    if (now) this.store.setSensors(now.sensors);
    if (this.isReading || player.loadedS >= range.lastS || player.timeS + piece < player.loadedS) return;
    this.isReading = true;
    const turn = this.turn, since = player.loadedS, until = Math.min(range.lastS, since + piece);
    this.read(since, until, Math.max(1, player.speed / 5)).then((found) => {
      if (turn !== this.turn) return;
      this.take(found);
      player.loadedS = until;
    }).catch(() => {}).finally(() => { if (turn === this.turn) this.isReading = false; });
  }

  async read(sinceS, untilS, stepS) {
    const answer = await ask(`/replay?since=${utc(sinceS)}&until=${utc(untilS)}&step_s=${stepS}`);
    return answer.json();
  }

  take(found) {
    this.store.addDetections(found.detections);
    this.timeline.set(found.activity.first_s, found.activity.sensors);
    found.tracks.forEach((track) => this.store.addTrack(track));
    this.sensors.push(...found.sensors.map((each) => ({ timeS: Date.parse(each.timestamp) / 1000, sensors: each.sensors })));
    if (this.sensors.length > 2000) this.sensors.splice(0, 1000);
  }
}
