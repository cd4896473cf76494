// What the selected robot's policy sees around it and thinks of it: three pictures, north up.

import {viridis} from './colours.js';

const kPeriodMs = 500;

function drawValues(canvas, side, values, best) {
  canvas.width = canvas.height = side;
  const known = values.filter(v => v !== null);
  const least = Math.min(...known), most = Math.max(...known);
  const context = canvas.getContext('2d', {willReadFrequently: true});
  const image = context.createImageData(side, side);
  values.forEach((value, i) => {
    if (value === null) return;
    const row = side - 1 - Math.floor(i / side);
    const share = most > least ? (value - least) / (most - least) : 0.5;
    image.data.set([...viridis(share), 255], 4 * (row * side + i % side));
  });
  context.putImageData(image, 0, 0);
  if (best !== null) {
    context.fillStyle = '#ff2d55';
    context.fillRect(best % side, side - 1 - Math.floor(best / side), 1, 1);
  }
  return known.length ? [least, most] : null;
}

function rangeText(range, digits, unit) {
  return range ? `${range[0].toFixed(digits)} to ${range[1].toFixed(digits)}${unit}` : 'nothing';
}

export class LocalPictures {
  constructor(section, nameOf) {
    this.section = section;
    this.nameOf = nameOf;
    this.robot = null;
    this.last = null;
    setInterval(() => this.ask(), kPeriodMs);
  }

  show(robot) {
    this.robot = robot;
    this.section.hidden = robot === null;
    this.ask();
  }

  async ask() {
    const robot = this.robot;
    if (robot === null || document.hidden) return;
    try {
      const response = await fetch(`api/local?robot=${robot}`);
      const local = await response.json();
      if (local && robot === this.robot) this.draw(local);
    } catch {
      // The connection's line says it.
    }
  }

  draw(local) {
    this.last = local;
    const part = id => this.section.querySelector(`#local-${id}`);
    part('title').textContent = `What ${this.nameOf(local.robot)} decides by`;
    const width = (local.side * local.cell_m).toFixed(1);
    part('note').textContent =
      `${width} m across, from the fleet's map, by the robot's own code. Brighter is more.`;
    const ivfm = drawValues(part('ivfm'), local.side, local.ivfm, null);
    part('ivfm-range').textContent = rangeText(ivfm, 1, '');
    const path = drawValues(part('path'), local.side, local.path, null);
    part('path-range').textContent = rangeText(path, 1, ' m');
    part('q-figure').hidden = local.q === null;
    if (local.q === null) return;
    const q = drawValues(part('q'), local.side, local.q, local.best);
    part('q-range').textContent = rangeText(q, 0, '');
    if (local.best === null) return;
    const east = (local.best % local.side + 0.5 - local.side / 2) * local.cell_m;
    const north = (Math.floor(local.best / local.side) + 0.5 - local.side / 2) * local.cell_m;
    part('q').setAttribute('aria-label',
      `Q map; the best goal is ${east.toFixed(1)} m east and ${north.toFixed(1)} m north`);
  }
}
