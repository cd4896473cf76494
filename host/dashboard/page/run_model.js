// What the page knows of the run: takes over the server's answers (docs/page.md).

export const kTileSide = 32;
const kTileCells = kTileSide * kTileSide;
const kTileBytes = 8 + kTileCells + kTileCells / 8;
const kMostPoints = 8000;

export class RunModel {
  constructor() {
    this.run = '';
    this.clear();
  }

  clear() {
    this.revision = 0;
    this.timeS = 0;
    this.cellM = 0;
    this.exploredCells = 0;
    this.explorableM2 = 0;
    this.tiles = new Map();
    this.robots = new Map();
    this.trails = new Map();
    this.samples = [];
    this.largestVisits = 0;
  }

  // Takes an answer (ArrayBuffer). Answers which tiles changed and whether there is more to ask for;
  // null when the answer does not continue what is known. Throws when it is damaged.
  take(buffer) {
    const view = new DataView(buffer);
    const textBytes = view.getUint32(0, true);
    const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, textBytes)));
    const cleared = head.run !== this.run || head.after !== this.revision;
    if (cleared) {
      this.clear();
      this.run = head.run;
      if (head.after !== 0) return null;
    }
    this.revision = head.revision;
    this.timeS = head.time_s;
    this.cellM = head.cell_m;
    this.exploredCells = head.explored_cells;
    this.explorableM2 = head.explorable_m2;
    for (const robot of head.robots) this.robots.set(robot.id, robot);
    for (const trail of head.trails) this.addTrail(trail.id, trail.points);
    for (const sample of head.samples) this.samples.push(sample);
    this.samples = thinned(this.samples);
    const tiles = [];
    for (let at = 4 + textBytes; at < buffer.byteLength; at += kTileBytes) {
      tiles.push(this.takeTile(view, buffer, at));
    }
    return {cleared, tiles, more: head.more};
  }

  takeTile(view, buffer, at) {
    const tile = {
      x: view.getInt32(at, true),
      y: view.getInt32(at + 4, true),
      visits: new Uint8Array(buffer.slice(at + 8, at + 8 + kTileCells)),
      obstacles: new Uint8Array(kTileCells),
    };
    const bits = new Uint8Array(buffer, at + 8 + kTileCells, kTileCells / 8);
    for (let i = 0; i < kTileCells; ++i) {
      tile.obstacles[i] = (bits[i >> 3] >> (i & 7)) & 1;
      if (tile.visits[i] > this.largestVisits) this.largestVisits = tile.visits[i];
    }
    this.tiles.set(`${tile.x},${tile.y}`, tile);
    return tile;
  }

  addTrail(id, points) {
    this.trails.set(id, thinned((this.trails.get(id) ?? []).concat(points)));
  }

  exploredM2() { return this.exploredCells * this.cellM * this.cellM; }
  // 0 .. 1 of what there is to see; null where nobody knows.
  exploredShare() { return this.explorableM2 > 0 ? this.exploredM2() / this.explorableM2 : null; }
  drivenM() { return sum(this.robots, robot => robot.distance_m ?? 0); }
  bytesPerS() { return sum(this.robots, robot => robot.bytes_per_s); }
  // Seconds of the run since the robot was heard.
  linkAgeS(robot) { return Math.max(0, this.timeS - robot.seen_s); }
}

function sum(robots, value) {
  let total = 0;
  for (const robot of robots.values()) total += value(robot);
  return total;
}

function thinned(list) {
  return list.length <= kMostPoints ? list : list.filter((_, i) => i % 2 === 0);
}
