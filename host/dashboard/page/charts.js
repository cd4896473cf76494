// Small curves over time, as SVG.

const kSvg = 'http://www.w3.org/2000/svg';
const kWidth = 368, kHeight = 120;
const kLeft = 44, kRight = 8, kTop = 10, kBottom = 22;

function element(name, attributes, text) {
  const node = document.createElementNS(kSvg, name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  if (text !== undefined) node.textContent = text;
  return node;
}

// A round number not below `value`: 1, 2 or 5 times a power of ten.
export function roundUp(value) {
  if (!(value > 0)) return 1;
  const power = 10 ** Math.floor(Math.log10(value));
  return [1, 2, 5, 10].map(factor => factor * power).find(round => round >= value * 0.9999);
}

// At most one point a pixel: the largest of those that share it.
function reduced(points, most) {
  if (points.length <= most) return points;
  const step = points.length / most;
  const out = [];
  for (let i = 0; i < most; ++i) {
    const part = points.slice(Math.floor(i * step), Math.max(Math.floor(i * step) + 1, Math.floor((i + 1) * step)));
    out.push(part.reduce((a, b) => (b[1] > a[1] ? b : a)));
  }
  out.push(points[points.length - 1]);
  return out;
}

// `points`: [seconds, value]. `unit` follows the largest value of the axis.
export function drawChart(svg, points, unit, label) {
  svg.setAttribute('viewBox', `0 0 ${kWidth} ${kHeight}`);
  svg.setAttribute('aria-label', label);
  const last = points.length ? points[points.length - 1][0] : 1;
  const first = points.length ? Math.min(points[0][0], last - 1) : 0;
  const most = roundUp(points.reduce((value, point) => Math.max(value, point[1]), 0));
  const x = time => kLeft + (time - first) / (last - first) * (kWidth - kLeft - kRight);
  const y = value => kHeight - kBottom - value / most * (kHeight - kTop - kBottom);
  const line = reduced(points, 300).map(([time, value]) => `${x(time).toFixed(1)},${y(value).toFixed(1)}`);
  svg.replaceChildren(
    element('path', {class: 'axis', d: `M${kLeft},${y(most)}H${kWidth - kRight}M${kLeft},${y(most / 2)}H${kWidth - kRight}M${kLeft},${y(0)}H${kWidth - kRight}`}),
    element('polyline', {class: 'line', points: line.join(' ')}),
    element('text', {x: kLeft - 6, y: y(most) + 4, 'text-anchor': 'end'}, String(most)),
    element('text', {x: kLeft - 6, y: y(0) + 4, 'text-anchor': 'end'}, '0'),
    element('text', {x: kLeft - 6, y: y(most / 2) + 4, 'text-anchor': 'end'}, unit),
    element('text', {x: kLeft, y: kHeight - 5}, `${Math.round(first)} s`),
    element('text', {x: kWidth - kRight, y: kHeight - 5, 'text-anchor': 'end'}, `${Math.round(last)} s`));
}
