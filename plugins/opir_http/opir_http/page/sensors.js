// The table of sensors: what each does, and what the tracker has found of its registration, noise and innovations.
import { byId } from "/page/panels.js";

const EXPECTED = [0.5, 2], MOST_OUTLIERS = 0.1, FAR = 3;
// A bias that is known this well, rad, is one that a scene states not to be there.
const LEAST_RAD = 5e-8;

const urad = (value, digits) => (1e6 * value).toFixed(digits).replace(/^-(0(\.0)?)$/, "$1");

const pair = (value, sigma) => { const digits = sigma < 1e-6 ? 1 : 0; return `${urad(value, digits)} ± ${urad(sigma, digits)}`; };

function bias({ bias_rad: [east, north], bias_sigma_rad: [sigma, other] }) {
  if (east === null) return "–";
  return Math.max(sigma, other) < LEAST_RAD ? "as stated" : `${pair(east, sigma)}, ${pair(north, other)}`;
}

const figure = (value, digits) => (value === null || value === undefined ? "–" : value.toFixed(digits));

// The cells of a sensor, and whether something of it needs a look.
export function lineOf(sensor) {
  const { health } = sensor, none = ["–", "–", "–", "–"], cells = [sensor.sensor_id, sensor.state];
  if (!health) return { cells: [...cells, ...none], isOdd: false };
  const clock = health.clock_s === null ? "–" : health.clock_sigma_s === 0 ? "as stated" : `${(1e3 * health.clock_s).toFixed(0)} ± ${(1e3 * health.clock_sigma_s).toFixed(0)}`;
  const isBiased = health.bias_rad.some((value, axis) => value !== null && Math.abs(value) > FAR * health.bias_sigma_rad[axis]);
  const isLate = health.clock_s !== null && Math.abs(health.clock_s) > FAR * health.clock_sigma_s;
  const isNoisy = health.innovations !== null && (health.innovations < EXPECTED[0] || health.innovations > EXPECTED[1]);
  return { cells: [...cells, bias(health), clock, figure(health.innovations, 2), figure(health.outlier_share, 2)], isOdd: isBiased || isLate || isNoisy || health.outlier_share > MOST_OUTLIERS };
}

export class SensorTable {
  constructor(onPick) {
    this.body = byId("sensor-rows"); this.text = "";
    this.body.addEventListener("click", (event) => { const row = event.target.closest("tr"); if (row && row.dataset.sensor) onPick(`sensor ${row.dataset.sensor}`); });
  }

  show(sensors) {
    const lines = sensors.map(lineOf), text = JSON.stringify(lines);
    if (text === this.text) return;
    this.text = text;
    const focused = document.activeElement && document.activeElement.closest("#sensor-rows tr"), kept = focused ? focused.dataset.sensor : null;
    this.body.replaceChildren(...lines.map(({ cells, isOdd }) => {
      const line = document.createElement("tr"), button = document.createElement("button");
      line.dataset.sensor = cells[0]; button.type = "button"; button.textContent = cells[0];
      line.insertCell().append(button);
      cells.slice(1).forEach((words) => { const cell = line.insertCell(); cell.textContent = words; if (isOdd) cell.className = "bad"; });
      return line;
    }));
    if (kept !== null) [...this.body.rows].find((row) => row.dataset.sensor === kept)?.querySelector("button").focus();
  }
}
