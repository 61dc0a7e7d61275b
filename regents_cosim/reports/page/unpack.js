// --- What the file carries: base64 of gzip of JSON, numbers as differences in whole units ---

const UNITS = { position: 0.01, yaw: 0.001, speed: 0.001 }; // as in packing.py: cm, mrad, mm/s

async function unpack(id) {
  const letters = document.getElementById(id).textContent;
  const bytes = Uint8Array.from(atob(letters), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).json();
}

function sums(differences, unit) {
  let total = 0;
  return Float64Array.from(differences, (step) => (total += step) * unit);
}

function points([x, y]) {
  const [xs, ys] = [sums(x, UNITS.position), sums(y, UNITS.position)];
  return Array.from(xs, (value, k) => [value, ys[k]]);
}

// Where one road user is, over stretches of steps without a gap.
class Track {
  constructor(spans) {
    this.stretches = spans.map(([first, x, y, yaw, speed]) => ({
      first,
      last: first + x.length - 1,
      x: sums(x, UNITS.position),
      y: sums(y, UNITS.position),
      yaw: sums(yaw, UNITS.yaw),
      speed: sums(speed, UNITS.speed),
    }));
  }

  // Between two steps everything is interpolated; headings were unwrapped before they were packed.
  at(step) {
    const here = this.stretches.find((part) => part.first <= step && step <= part.last);
    if (!here) return null;
    const low = Math.floor(step - here.first);
    const high = Math.min(low + 1, here.last - here.first);
    const share = step - here.first - low;
    const between = (values) => values[low] + share * (values[high] - values[low]);
    return { x: between(here.x), y: between(here.y), yaw: between(here.yaw), speed: between(here.speed) };
  }

  // Positions from one step to another, a list per stretch.
  path(from, to) {
    const found = [];
    for (const part of this.stretches) {
      const line = [];
      for (let k = Math.max(part.first, Math.ceil(from)); k <= Math.min(part.last, Math.floor(to)); k++) {
        line.push([part.x[k - part.first], part.y[k - part.first]]);
      }
      const tip = to > part.first && to < part.last ? this.at(to) : null;
      if (tip) line.push([tip.x, tip.y]);
      if (line.length > 1) found.push(line);
    }
    return found;
  }

  // [step, value] of the speed, or of the acceleration midway between two steps.
  speeds() {
    return this.stretches.map((part) => Array.from(part.speed, (speed, k) => [part.first + k, speed]));
  }

  accelerations(dt) {
    return this.stretches.map((part) =>
      Array.from(part.speed.subarray(1), (speed, k) => [part.first + k + 0.5, (speed - part.speed[k]) / dt]),
    );
  }
}

function series(spans) {
  return spans.map(([first, values]) => Array.from(sums(values, UNITS.position), (value, k) => [first + k, value]));
}
