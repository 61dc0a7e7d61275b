// --- Ground: road, sidewalks, crossings, markings, and the lights at stop lines ---

const LIGHTS = { r: "red", s: "red", y: "amber", Y: "amber", u: "amber", g: "green", G: "green" };

class Ground {
  constructor(map) {
    this.road = pathOf(map.rings, true);
    this.walks = pathOf(map.walks, true);
    this.stripes = pathOf(map.stripes, true);
    this.dashed = pathOf(map.dashed, false);
    this.solid = pathOf(map.solid, false);
    this.bars = map.bars.map(({ signal, link, corners }) => ({ signal, link, shape: pathOf([corners], true) }));
  }

  // `context` in metres.
  draw(context, pixel) {
    context.fillStyle = colours.road;
    context.fill(this.road, "evenodd");
    context.strokeStyle = colours.kerb;
    context.lineWidth = Math.max(0.12, pixel);
    context.stroke(this.road);
    context.fillStyle = colours.pavement;
    context.fill(this.walks, "evenodd");
    context.stroke(this.walks);
    context.fillStyle = colours.marking;
    context.fill(this.stripes);
    context.strokeStyle = colours.marking;
    context.lineWidth = Math.max(0.16, pixel);
    context.stroke(this.solid);
    context.setLineDash([3, 4.5]);
    context.stroke(this.dashed);
    context.setLineDash([]);
  }

  drawLights(context, pixel, signals, step) {
    for (const { signal, link, shape } of this.bars) {
      if (!(signal in signals)) continue;
      const letters = signals[signal].findLast(([since]) => since <= step)[1];
      context.fillStyle = colours[LIGHTS[letters[link]] ?? "off"];
      context.strokeStyle = colours.ink;
      context.lineWidth = pixel;
      context.fill(shape);
      context.stroke(shape);
    }
  }
}

function pathOf(lines, closed) {
  const path = new Path2D();
  for (const line of lines) {
    points(line).forEach(([x, y], k) => (k ? path.lineTo(x, y) : path.moveTo(x, y)));
    if (closed) path.closePath();
  }
  return path;
}
