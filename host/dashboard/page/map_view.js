// The map on its canvas: tiles in pictures of 256 x 256 cells, robots above, pan and zoom.

import {parseColour, robotColour, scaleEnd, visitColour} from './colours.js';
import {kTileSide} from './run_model.js';

const kChunkTiles = 8;
const kChunkSide = kChunkTiles * kTileSide;
const kLeastScale = 0.5, kMostScale = 2000;  // pixels a metre
const kRobotRadiusM = 0.18;

export class MapView {
  constructor(canvas, model) {
    this.canvas = canvas;
    this.model = model;
    this.context = canvas.getContext('2d');
    this.chunks = new Map();
    this.scaleEnd = 8;
    this.centre = [0, 0];
    this.scale = 40;
    this.following = true;  // shows everything until somebody moves the map
    this.selected = null;
    this.stale = true;
    this.readTheme();
    this.listen();
    new ResizeObserver(() => this.changed()).observe(canvas);
  }

  changed() {
    if (this.stale) return;
    this.stale = true;
    requestAnimationFrame(() => this.draw());
  }

  start() {
    this.stale = false;
    this.changed();
  }

  readTheme() {
    const style = getComputedStyle(document.documentElement);
    const colour = name => style.getPropertyValue(name).trim();
    this.theme = {unknown: colour('--unknown'), grid: colour('--grid'), halo: colour('--halo'),
      ink: colour('--ink'), faint: colour('--faint'), obstacle: parseColour(colour('--obstacle'))};
    this.redrawTiles();
  }

  clear() {
    this.chunks.clear();
    this.following = true;
  }

  // --- Tiles ---

  takeTiles(tiles) {
    const end = scaleEnd(this.model.largestVisits);
    if (end !== this.scaleEnd) {
      this.scaleEnd = end;
      this.redrawTiles();
    } else {
      for (const tile of tiles) this.drawTile(tile);
    }
    this.changed();
  }

  redrawTiles() {
    this.palette = [null];
    for (let visits = 1; visits < 256; ++visits) {
      this.palette.push(visitColour(Math.min(visits, this.scaleEnd), this.scaleEnd));
    }
    for (const tile of this.model.tiles.values()) this.drawTile(tile);
    this.changed();
  }

  chunkOf(tile) {
    const x = Math.floor(tile.x / kChunkTiles), y = Math.floor(tile.y / kChunkTiles);
    const key = `${x},${y}`;
    let chunk = this.chunks.get(key);
    if (!chunk) {
      const canvas = document.createElement('canvas');
      canvas.width = canvas.height = kChunkSide;
      chunk = {x, y, canvas, context: canvas.getContext('2d', {willReadFrequently: true})};
      this.chunks.set(key, chunk);
    }
    return chunk;
  }

  // Where in its chunk's picture a tile's upper left corner is: north is up.
  placeInChunk(tile, chunk) {
    return [(tile.x - chunk.x * kChunkTiles) * kTileSide,
      kChunkSide - (tile.y - chunk.y * kChunkTiles + 1) * kTileSide];
  }

  drawTile(tile) {
    const chunk = this.chunkOf(tile);
    const image = chunk.context.createImageData(kTileSide, kTileSide);
    for (let i = 0; i < tile.visits.length; ++i) {
      const colour = tile.obstacles[i] ? this.theme.obstacle : this.palette[tile.visits[i]];
      if (!colour) continue;
      const row = kTileSide - 1 - Math.floor(i / kTileSide);
      image.data.set([...colour, 255], 4 * (row * kTileSide + i % kTileSide));
    }
    chunk.context.putImageData(image, ...this.placeInChunk(tile, chunk));
  }

  // What is drawn of a tile, read back from the picture: a colour '#rrggbb' a cell, row by row from
  // the lowest, '' where nothing is. For tests.
  drawnCells(x, y) {
    const tile = {x, y};
    const chunk = this.chunkOf(tile);
    const [left, top] = this.placeInChunk(tile, chunk);
    const data = chunk.context.getImageData(left, top, kTileSide, kTileSide).data;
    const cells = [];
    for (let row = kTileSide - 1; row >= 0; --row) {
      for (let column = 0; column < kTileSide; ++column) {
        const at = 4 * (row * kTileSide + column);
        const digits = [...data.slice(at, at + 3)].map(v => v.toString(16).padStart(2, '0'));
        cells.push(data[at + 3] ? `#${digits.join('')}` : '');
      }
    }
    return cells;
  }

  // --- View ---

  // Pixels of the screen from metres.
  toScreen([x, y]) {
    return [this.width / 2 + (x - this.centre[0]) * this.scale,
      this.height / 2 - (y - this.centre[1]) * this.scale];
  }

  toMap(px, py) {
    return [this.centre[0] + (px - this.width / 2) / this.scale,
      this.centre[1] - (py - this.height / 2) / this.scale];
  }

  zoom(factor, px = this.width / 2, py = this.height / 2) {
    const before = this.toMap(px, py);
    this.scale = Math.min(kMostScale, Math.max(kLeastScale, this.scale * factor));
    const after = this.toMap(px, py);
    this.centre = [this.centre[0] + before[0] - after[0], this.centre[1] + before[1] - after[1]];
    this.following = false;
    this.changed();
  }

  move(dx, dy) {
    this.centre = [this.centre[0] - dx / this.scale, this.centre[1] + dy / this.scale];
    this.following = false;
    this.changed();
  }

  fit() {
    this.following = true;
    this.changed();
  }

  goTo(place) {
    this.centre = [...place];
    this.scale = Math.max(this.scale, 60);
    this.following = false;
    this.changed();
  }

  // In metres: what is seen, cell by cell at the edges, and the robots.
  bounds() {
    let box = null;
    const add = (x, y) => {
      box ??= [x, y, x, y];
      box = [Math.min(box[0], x), Math.min(box[1], y), Math.max(box[2], x), Math.max(box[3], y)];
    };
    const side = kTileSide * this.model.cellM;
    for (const tile of this.model.tiles.values()) {
      const seen = tileExtent(tile);
      if (!seen) continue;
      add(tile.x * side + seen[0] * this.model.cellM, tile.y * side + seen[1] * this.model.cellM);
      add(tile.x * side + seen[2] * this.model.cellM, tile.y * side + seen[3] * this.model.cellM);
    }
    for (const robot of this.model.robots.values()) {
      if (robot.x !== undefined) add(robot.x, robot.y);
    }
    return box;
  }

  showAll() {
    const box = this.bounds();
    if (!box) return;
    const margin = 24;
    const above = 60, below = document.querySelector('.legend').offsetHeight + 24;
    const width = Math.max(50, this.width - 2 * margin);
    const height = Math.max(50, this.height - above - below);
    this.scale = Math.min(width / Math.max(1, box[2] - box[0]), height / Math.max(1, box[3] - box[1]));
    this.centre = [(box[0] + box[2]) / 2,
      (box[1] + box[3]) / 2 + (above - below) / 2 / this.scale];
  }

  // --- Drawing ---

  draw() {
    this.stale = false;
    const ratio = window.devicePixelRatio || 1;
    this.width = this.canvas.clientWidth;
    this.height = this.canvas.clientHeight;
    const pixels = [Math.round(this.width * ratio), Math.round(this.height * ratio)];
    if (this.canvas.width !== pixels[0]) this.canvas.width = pixels[0];
    if (this.canvas.height !== pixels[1]) this.canvas.height = pixels[1];
    if (this.following) this.showAll();
    const c = this.context;
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.fillStyle = this.theme.unknown;
    c.fillRect(0, 0, this.width, this.height);
    this.drawGrid(c);
    this.drawChunks(c, ratio);
    for (const [id, points] of this.model.trails) this.drawTrail(c, id, points);
    for (const robot of this.model.robots.values()) this.drawGoal(c, robot);
    for (const robot of this.model.robots.values()) this.drawRobot(c, robot);
    this.drawScaleBar(c);
  }

  // Lines every 1, 5, 10 or 50 m.
  drawGrid(c) {
    const step = [1, 5, 10, 50].find(metres => metres * this.scale >= 24) ?? 50;
    const [left, top] = this.toMap(0, 0), [right, bottom] = this.toMap(this.width, this.height);
    c.strokeStyle = this.theme.grid;
    c.lineWidth = 1;
    c.beginPath();
    for (let x = Math.ceil(left / step) * step; x <= right; x += step) {
      const px = Math.round(this.toScreen([x, 0])[0]) + 0.5;
      c.moveTo(px, 0);
      c.lineTo(px, this.height);
    }
    for (let y = Math.ceil(bottom / step) * step; y <= top; y += step) {
      const py = Math.round(this.toScreen([0, y])[1]) + 0.5;
      c.moveTo(0, py);
      c.lineTo(this.width, py);
    }
    c.stroke();
  }

  drawChunks(c, ratio) {
    const side = kChunkSide * this.model.cellM;
    c.imageSmoothingEnabled = this.scale * this.model.cellM * ratio < 1;
    for (const chunk of this.chunks.values()) {
      const [left, top] = this.toScreen([chunk.x * side, (chunk.y + 1) * side]);
      const [right, bottom] = this.toScreen([(chunk.x + 1) * side, chunk.y * side]);
      if (right < 0 || bottom < 0 || left > this.width || top > this.height) continue;
      c.drawImage(chunk.canvas, left, top, right - left, bottom - top);
    }
  }

  drawTrail(c, id, points) {
    if (this.selected !== null && this.selected !== id) return;
    const path = new Path2D();
    for (const point of points) path.lineTo(...this.toScreen(point));
    c.lineJoin = 'round';
    c.strokeStyle = this.theme.halo;
    c.globalAlpha = 0.75;
    c.lineWidth = 4;
    c.stroke(path);
    c.globalAlpha = 1;
    c.strokeStyle = robotColour(id);
    c.lineWidth = 2;
    c.stroke(path);
  }

  drawGoal(c, robot) {
    if (!robot.goal || robot.x === undefined || robot.state !== 'exploring') return;
    const from = this.toScreen([robot.x, robot.y]), to = this.toScreen(robot.goal);
    for (const [colour, width] of [[this.theme.halo, 5], [robotColour(robot.id), 2]]) {
      c.strokeStyle = colour;
      c.lineWidth = width;
      c.setLineDash([6, 5]);
      c.beginPath();
      c.moveTo(...from);
      c.lineTo(...to);
      c.stroke();
      c.setLineDash([]);
      c.beginPath();
      c.arc(...to, 7, 0, 2 * Math.PI);
      c.stroke();
    }
  }

  // A disc with a wedge towards its heading, and its number.
  drawRobot(c, robot) {
    if (robot.x === undefined) return;
    const [x, y] = this.toScreen([robot.x, robot.y]);
    const radius = Math.max(8, kRobotRadiusM * this.scale);
    c.save();
    c.translate(x, y);
    c.rotate(-robot.heading);
    const body = new Path2D();
    body.arc(0, 0, radius, 0.6, 2 * Math.PI - 0.6);
    body.lineTo(1.6 * radius, 0);
    body.closePath();
    c.strokeStyle = this.theme.halo;
    c.lineWidth = 4;
    c.stroke(body);
    c.fillStyle = robotColour(robot.id);
    c.fill(body);
    if (this.selected === robot.id) {
      c.strokeStyle = this.theme.ink;
      c.lineWidth = 2;
      c.stroke(body);
    }
    c.restore();
    c.fillStyle = '#fff';
    c.font = '600 11px system-ui, "DejaVu Sans", sans-serif';
    c.textAlign = 'center';
    c.textBaseline = 'middle';
    c.fillText(String(robot.id), x, y + 0.5);
  }

  drawScaleBar(c) {
    const metres = [1, 2, 5, 10, 20, 50, 100].find(m => m * this.scale >= 70) ?? 200;
    const right = this.width - 16, y = 26, left = right - metres * this.scale;
    for (const [colour, width] of [[this.theme.halo, 6], [this.theme.ink, 2]]) {
      c.strokeStyle = colour;
      c.lineWidth = width;
      c.beginPath();
      c.moveTo(left, y);
      c.lineTo(right, y);
      c.stroke();
    }
    c.font = '12px system-ui, "DejaVu Sans", sans-serif';
    c.textAlign = 'right';
    c.textBaseline = 'top';
    c.lineWidth = 4;
    c.strokeStyle = this.theme.halo;
    c.strokeText(`${metres} m`, right, y + 6);
    c.fillStyle = this.theme.ink;
    c.fillText(`${metres} m`, right, y + 6);
  }

  // --- Input ---

  listen() {
    const pointers = new Map();
    const canvas = this.canvas;
    canvas.addEventListener('pointerdown', event => {
      canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
    });
    canvas.addEventListener('pointermove', event => {
      const before = pointers.get(event.pointerId);
      if (!before) return;
      const now = [event.offsetX, event.offsetY];
      if (pointers.size === 2) this.pinch(pointers, event.pointerId, now);
      this.move((now[0] - before[0]) / pointers.size, (now[1] - before[1]) / pointers.size);
      pointers.set(event.pointerId, now);
    });
    for (const end of ['pointerup', 'pointercancel']) {
      canvas.addEventListener(end, event => pointers.delete(event.pointerId));
    }
    canvas.addEventListener('wheel', event => {
      event.preventDefault();
      this.zoom(Math.exp(-event.deltaY / 400), event.offsetX, event.offsetY);
    }, {passive: false});
    canvas.addEventListener('keydown', event => this.key(event));
  }

  pinch(pointers, id, now) {
    const [other] = [...pointers].filter(([key]) => key !== id).map(([, place]) => place);
    const before = pointers.get(id);
    const distance = place => Math.hypot(place[0] - other[0], place[1] - other[1]);
    if (distance(before) > 5) this.zoom(distance(now) / distance(before), ...other);
  }

  key(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const actions = {
      ArrowLeft: () => this.move(60, 0), ArrowRight: () => this.move(-60, 0),
      ArrowUp: () => this.move(0, 60), ArrowDown: () => this.move(0, -60),
      '+': () => this.zoom(1.25), '=': () => this.zoom(1.25), '-': () => this.zoom(0.8),
      '0': () => this.fit(),
    };
    if (!actions[event.key]) return;
    event.preventDefault();
    actions[event.key]();
  }
}

// First and last column and row with anything, as [left, bottom, right, top] in cells; kept.
function tileExtent(tile) {
  if (tile.extent !== undefined) return tile.extent;
  let box = null;
  for (let i = 0; i < tile.visits.length; ++i) {
    if (!tile.visits[i] && !tile.obstacles[i]) continue;
    const x = i % kTileSide, y = Math.floor(i / kTileSide);
    box ??= [x, y, x + 1, y + 1];
    box = [Math.min(box[0], x), Math.min(box[1], y), Math.max(box[2], x + 1), Math.max(box[3], y + 1)];
  }
  tile.extent = box;
  return box;
}
