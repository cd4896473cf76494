// The live page: asks the server for changes ten times a second and shows them.

import {drawChart} from './charts.js';
import {robotColour, visitColour} from './colours.js';
import {LocalPictures} from './local_pictures.js';
import {MapView} from './map_view.js';
import {RunModel} from './run_model.js';

const kPeriodMs = 100, kHiddenPeriodMs = 1000, kRetryMs = 1000;
const kChartPeriodMs = 1000, kSpeechPeriodMs = 10000;
const kLateS = 3;      // a link this old is shown as late
const kLossy = 0.2;    // and one that loses more than this share as bad

const byId = id => document.getElementById(id);
const model = new RunModel();
setTheme(localStorage.getItem('ivfm-theme') ??
  (matchMedia('(prefers-color-scheme: dark)').matches ? 'dark' : 'light'));
const view = new MapView(byId('map'), model);
const local = new LocalPictures(byId('local'), id => nameOf(model.robots.get(id) ?? {id}));

// --- Numbers ---

function bytesText(bytes) {
  if (bytes < 1000) return `${Math.round(bytes)} B`;
  return bytes < 1e6 ? `${(bytes / 1e3).toFixed(1)} kB` : `${(bytes / 1e6).toFixed(1)} MB`;
}

function timeText(seconds) {
  const whole = Math.floor(seconds);
  const two = value => String(value).padStart(2, '0');
  const hours = Math.floor(whole / 3600);
  return (hours ? `${hours}:` : '') + `${two(Math.floor(whole / 60) % 60)}:${two(whole % 60)}`;
}

function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

function exploredText() {
  const share = model.exploredShare();
  return `${model.exploredM2().toFixed(1)} m²` + (share === null ? '' : `, ${(share * 100).toFixed(1)} %`);
}

function showNumbers() {
  setText(byId('explored'), exploredText());
  setText(byId('time'), timeText(model.timeS));
  setText(byId('driven'), `${model.drivenM().toFixed(1)} m`);
  setText(byId('radio'), `${bytesText(model.bytesPerS())}/s`);
  byId('empty').hidden = model.robots.size > 0;
}

// For screen readers, seldom enough to listen to.
let spokenAt = 0;
function speak() {
  const now = performance.now();
  if (now - spokenAt < kSpeechPeriodMs || model.robots.size === 0) return;
  spokenAt = now;
  const states = [...model.robots.values()].map(robot => `${nameOf(robot)} ${robot.state ?? 'unknown'}`);
  setText(byId('spoken'), `${model.exploredM2().toFixed(0)} square metres explored, ` +
    `${model.drivenM().toFixed(0)} metres driven, ${states.join(', ')}.`);
}

let chartsAt = 0;
function showCharts() {
  const now = performance.now();
  if (now - chartsAt < kChartPeriodMs) return;
  chartsAt = now;
  const share = model.explorableM2 > 0;  // of what there is to see, else the area
  const perCell = model.cellM * model.cellM / (share ? model.explorableM2 / 100 : 1);
  setText(byId('area-title'), share ? 'Explored share' : 'Explored area');
  drawChart(byId('area-chart'), model.samples.map(s => [s[0], s[1] * perCell]), share ? '%' : 'm²',
    `${byId('area-title').textContent} over time, now ${exploredText()}`);
  drawChart(byId('radio-chart'), model.samples.map(s => [s[0], s[2] / 1e3]), 'kB/s',
    `Radio traffic over time, now ${bytesText(model.bytesPerS())} a second`);
}

// --- Robots ---

function nameOf(robot) { return robot.name || `robot ${robot.id}`; }

const rows = new Map();
function rowOf(robot) {
  let row = rows.get(robot.id);
  if (row) return row;
  row = document.createElement('tr');
  for (let i = 0; i < 7; ++i) row.append(document.createElement('td'));
  const button = document.createElement('button');
  button.type = 'button';
  button.setAttribute('aria-pressed', 'false');
  button.title = 'Show this robot on the map';
  const dot = document.createElement('span');
  dot.className = 'dot';
  dot.style.background = robotColour(robot.id);
  button.append(dot, document.createElement('span'));
  button.addEventListener('click', () => select(robot.id));
  row.cells[0].append(button);
  const after = [...rows].filter(([id]) => id < robot.id).length;
  const body = byId('robots').tBodies[0];
  body.insertBefore(row, body.rows[after] ?? null);
  rows.set(robot.id, row);
  const option = document.createElement('option');
  option.value = String(robot.id);
  option.textContent = nameOf(robot);
  byId('target').append(option);
  return row;
}

// The causes in a status message, as firmware/supervisor/supervisor.h numbers them.
const kCauses = ['lidar silent', 'odometry silent', 'drive lost', 'stop command', 'internal error',
  'obstacle'];
function stateText(robot) {
  const apart = robot.apart ? ', map apart' : '';
  if (robot.state !== 'fault') return (robot.state ?? 'unknown') + apart;
  const causes = kCauses.filter((_, bit) => robot.fault >> bit & 1);
  return (causes.length ? `fault: ${causes.join(', ')}` : 'fault') + apart;
}

function showRobots() {
  for (const robot of model.robots.values()) {
    const cells = rowOf(robot).cells;
    const age = model.linkAgeS(robot);
    setText(cells[0].firstChild.lastChild, nameOf(robot));
    setText(cells[1], stateText(robot));
    setText(cells[2], `${age.toFixed(1)} s`);
    setText(cells[3], `${(robot.lost * 100).toFixed(0)} %`);
    setText(cells[4], `${(robot.distance_m ?? 0).toFixed(1)} m`);
    setText(cells[5], String(robot.actions ?? 0));
    setText(cells[6], `${bytesText(robot.bytes_per_s)}/s`);
    cells[1].className = robot.state === 'fault' ? 'fault' : '';
    cells[2].className = age > kLateS ? 'late' : '';
    cells[3].className = robot.lost > kLossy ? 'late' : '';
  }
}

function select(id) {
  view.selected = view.selected === id ? null : id;
  for (const [other, row] of rows) {
    row.cells[0].firstChild.setAttribute('aria-pressed', String(other === view.selected));
  }
  const robot = model.robots.get(id);
  if (view.selected !== null && robot?.x !== undefined) view.goTo([robot.x, robot.y]);
  local.show(view.selected);
  view.changed();
}

function forgetRobots() {
  for (const row of rows.values()) row.remove();
  rows.clear();
  byId('target').length = 1;
}

// --- Legend and colours ---

let legendEnd = 0;
function showLegend() {
  if (legendEnd === view.scaleEnd) return;
  legendEnd = view.scaleEnd;
  const c = byId('legend-bar').getContext('2d');
  for (let i = 0; i < 256; ++i) {
    const [red, green, blue] = visitColour(legendEnd ** (i / 255), legendEnd);
    c.fillStyle = `rgb(${red} ${green} ${blue})`;
    c.fillRect(i, 0, 1, 1);
  }
  setText(byId('legend-middle'), String(Math.round(Math.sqrt(legendEnd))));
  setText(byId('legend-most'), legendEnd === 255 ? '255 or more' : String(legendEnd));
}

function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  byId('theme').textContent = theme === 'dark' ? 'Light colours' : 'Dark colours';
}

byId('theme').addEventListener('click', () => {
  const theme = document.documentElement.dataset.theme === 'dark' ? 'light' : 'dark';
  localStorage.setItem('ivfm-theme', theme);
  setTheme(theme);
  view.readTheme();
});

// --- Commands ---

function readToken() {
  const given = new URLSearchParams(location.hash.slice(1)).get('token');
  if (given) {
    sessionStorage.setItem('ivfm-token', given);
    history.replaceState(null, '', location.pathname);
  }
  byId('token').value = sessionStorage.getItem('ivfm-token') ?? '';
  byId('token-row').hidden = byId('token').value !== '';
  allowCommands();
}

function allowCommands() {
  for (const button of document.querySelectorAll('[data-command]')) {
    button.disabled = byId('token').value === '';
  }
}

function say(text, bad) {
  byId('answer').textContent = text;
  byId('answer').classList.toggle('bad', bad);
}

async function command(name) {
  const target = byId('target');
  const body = {command: name};
  const all = target.value === '' || name === 'stop';
  if (!all) body.robot = Number(target.value);
  try {
    const response = await fetch('api/command', {method: 'POST', body: JSON.stringify(body),
      headers: {'X-Ivfm-Token': byId('token').value.trim()}});
    if (response.ok) {
      say(`Asked ${all ? 'all robots' : target.selectedOptions[0].textContent} to ${name}.`, false);
      return;
    }
    if (response.status === 403) byId('token-row').hidden = false;
    say(`Not done: ${await response.text()}.`, true);
  } catch {
    say('Not done: the server does not answer.', true);
  }
}

byId('token').addEventListener('input', () => {
  sessionStorage.setItem('ivfm-token', byId('token').value.trim());
  allowCommands();
});
for (const button of document.querySelectorAll('[data-command]')) {
  button.addEventListener('click', () => command(button.dataset.command));
}
byId('zoom-in').addEventListener('click', () => view.zoom(1.25));
byId('zoom-out').addEventListener('click', () => view.zoom(0.8));
byId('fit').addEventListener('click', () => view.fit());

// --- The loop ---

const sleep = ms => new Promise(done => setTimeout(done, ms));

// Asks once; answers whether there is more at once.
async function askForChanges() {
  const response = await fetch(`api/changes?run=${model.run}&since=${model.revision}`);
  if (!response.ok) throw new Error(`status ${response.status}`);
  const news = model.take(await response.arrayBuffer());
  if (!news) return true;
  if (news.cleared) {
    view.clear();
    forgetRobots();
  }
  view.takeTiles(news.tiles);
  return news.more;
}

function show() {
  showNumbers();
  showRobots();
  showLegend();
  showCharts();
  speak();
}

function showConnection(good) {
  setText(byId('connection'), good ? 'Connected' : 'No answer from the server; this is what it told last');
  byId('connection').classList.toggle('lost', !good);
  document.body.classList.toggle('stale', !good);
}

async function run() {
  for (;;) {
    const begin = performance.now();
    try {
      while (await askForChanges());
      showConnection(true);
      show();
      await sleep(Math.max(0, (document.hidden ? kHiddenPeriodMs : kPeriodMs) - (performance.now() - begin)));
    } catch {
      showConnection(false);
      await sleep(kRetryMs);
    }
  }
}

readToken();
view.start();
window.ivfmPage = {model, view, local, drawnCells: (x, y) => view.drawnCells(x, y)};
run();
