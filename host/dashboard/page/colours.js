// Colours of the map: viridis for visits, on a logarithmic scale.

// Anchors of viridis (matplotlib), evenly spaced; between them linear in sRGB.
const kViridis = [
  [0x44, 0x01, 0x54], [0x47, 0x2d, 0x7b], [0x3b, 0x52, 0x8b], [0x2c, 0x72, 0x8e],
  [0x21, 0x91, 0x8c], [0x28, 0xae, 0x80], [0x5e, 0xc9, 0x62], [0xad, 0xdc, 0x30],
  [0xfd, 0xe7, 0x25],
];
const kRobots = ['#d9480f', '#6741d9', '#1971c2', '#c2255c', '#846358', '#0b7285', '#e67700', '#364fc7'];

// share: 0 .. 1. Answers [red, green, blue].
export function viridis(share) {
  const place = Math.min(1, Math.max(0, share)) * (kViridis.length - 1);
  const low = Math.min(kViridis.length - 2, Math.floor(place));
  const part = place - low;
  return kViridis[low].map((value, i) => Math.round(value + (kViridis[low + 1][i] - value) * part));
}

// The colour of a cell with `visits` (1 ..) where `most` is the end of the scale. The darkest part
// of viridis is left out: it would not stand out from a dark page.
export function visitColour(visits, most) {
  return viridis(0.12 + 0.88 * Math.log(visits) / Math.log(Math.max(2, most)));
}

// The end of the scale for a largest count: 8, 16, ... 128, 255.
export function scaleEnd(largest) {
  let end = 8;
  while (end < largest) end *= 2;
  return Math.min(255, end);
}

export function robotColour(id) {
  return kRobots[(id + kRobots.length - 1) % kRobots.length];
}

// '#rrggbb' as [red, green, blue].
export function parseColour(text) {
  const value = parseInt(text.trim().slice(1), 16);
  return [value >> 16, (value >> 8) & 255, value & 255];
}
