// --- Colours: those of the style sheet, by day and by night ---

const NAMES = ["page", "panel", "hairline", "ink", "faint", "land", "road", "kerb", "pavement", "marking", "other", "ego", "adversary",
  "second", "evasion", "ego-ink", "adversary-ink", "second-ink", "evasion-ink", "burst", "red", "amber", "green", "off"];
const DRIVERS = ["ego", "second"]; // the colours of who drives the ego
let colours = {};

function readColours() {
  const style = getComputedStyle(document.documentElement);
  colours = Object.fromEntries(NAMES.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
}

// A canvas as sharp as the screen; returns its context, scaled to CSS pixels, and its size in them.
function sharp(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const { clientWidth: width, clientHeight: height } = canvas;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return { context, width, height, ratio };
}
