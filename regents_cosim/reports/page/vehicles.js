// --- Road users: bodies that show where their front is, trails, ghosts, and the mark of a collision ---

function drawBody(context, pixel, pose, { size: [length, width], kind }, colour, look = {}) {
  context.save();
  context.translate(pose.x, pose.y);
  context.rotate(pose.yaw);
  context.globalAlpha = look.alpha ?? 1;
  const body = new Path2D();
  if (kind === "pedestrian") body.ellipse(0, 0, length / 2, width / 2, 0, 0, 2 * Math.PI);
  else body.roundRect(-length / 2, -width / 2, length, width, 0.22 * width);
  context.fillStyle = look.ghost ? transparent(colour, look.ghost) : colour;
  context.fill(body);
  context.lineWidth = look.ghost ? 1.6 * pixel : pixel;
  context.strokeStyle = look.ghost ? colour : transparent(colours.ink, 0.55);
  if (look.dashed) context.setLineDash([5 * pixel, 3 * pixel]);
  context.stroke(body);
  context.setLineDash([]);
  context.fillStyle = look.ghost ? transparent(colour, 0.6) : "rgba(10, 14, 20, .62)"; // glass, or an arrow for who has none
  context.fill(["car", "truck", "bus", "other"].includes(kind) ? windscreen(length, width) : arrow(length, width));
  context.restore();
}

function windscreen(length, width) {
  const glass = new Path2D();
  const [back, front] = [0.14 * length, 0.14 * length + Math.min(0.16 * length, 0.8)];
  glass.moveTo(back, -0.34 * width);
  glass.lineTo(front, -0.42 * width);
  glass.lineTo(front, 0.42 * width);
  glass.lineTo(back, 0.34 * width);
  glass.closePath();
  return glass;
}

function arrow(length, width) {
  const tip = new Path2D();
  tip.moveTo(0.38 * length, 0);
  tip.lineTo(0, 0.34 * width);
  tip.lineTo(0, -0.34 * width);
  tip.closePath();
  return tip;
}

function drawPath(context, lines, colour, width, dash = []) {
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.lineJoin = context.lineCap = "round";
  context.setLineDash(dash);
  for (const line of lines) {
    context.beginPath();
    line.forEach(([x, y], k) => (k ? context.lineTo(x, y) : context.moveTo(x, y)));
    context.stroke();
  }
  context.setLineDash([]);
}

// A dot on a path at each whole second that is over.
function drawSeconds(context, pixel, track, until, second, colour) {
  for (let step = second; step < until - 0.3 * second; step += second) {
    const place = track.at(step);
    if (!place) continue;
    for (const [radius, fill] of [[4, colours.panel], [2.75, colour]]) {
      context.beginPath();
      context.arc(place.x, place.y, radius * pixel, 0, 2 * Math.PI);
      context.fillStyle = fill;
      context.fill();
    }
  }
}

// In metres: triangles across a lane that point to who gives way, a cross where a rule is broken, a ring where a danger is seen, a bar where a careful driver begins to brake.
function drawRoadMark(context, pixel, { kind, x, y, yaw, width }, colour) {
  const lines = new Path2D();
  if (kind === "gives_way") {
    const [tall, count] = [Math.max(1, 9 * pixel), Math.max(2, Math.round(width / Math.max(1, 9 * pixel)))];
    for (let k = 0; k < count; k++) {
      const [middle, half] = [(width * (k + 0.5)) / count - 0.5 * width, (0.42 * width) / count];
      lines.moveTo(0, middle - half);
      lines.lineTo(0, middle + half);
      lines.lineTo(-tall, middle);
      lines.closePath();
    }
  } else if (kind === "breaks_rule") {
    for (const side of [1, -1]) {
      lines.moveTo(-5 * pixel, -5 * side * pixel);
      lines.lineTo(5 * pixel, 5 * side * pixel);
    }
  } else if (kind === "is_seen") {
    lines.arc(0, 0, 6 * pixel, 0, 2 * Math.PI);
  } else {
    const reach = 0.5 * width + 5 * pixel;
    lines.moveTo(0, -reach);
    lines.lineTo(0, reach);
  }
  context.save();
  context.translate(x, y);
  context.rotate(yaw);
  if (kind === "gives_way") {
    context.fillStyle = colours.panel;
    context.fill(lines);
  }
  for (const [wide, stroke] of kind === "gives_way" ? [[1.8, colour]] : [[6, colours.panel], [3, colour]]) {
    context.lineWidth = wide * pixel;
    context.strokeStyle = stroke;
    context.stroke(lines);
  }
  context.restore();
}

function kmh(speed) {
  return `${(3.6 * speed).toFixed(0)} km/h`;
}

// In pixels: a star with a ring that opens around it.
function drawMark(context, [x, y], sinceSeconds) {
  const radius = 17 * (0.65 + 0.35 * Math.min(sinceSeconds / 0.5, 1));
  for (const [colour, width] of [[colours.panel, 5], [colours.ink, 2]]) {
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.beginPath();
    context.arc(x, y, radius, 0, 2 * Math.PI);
    context.stroke();
  }
  const star = new Path2D();
  for (let k = 0; k < 16; k++) {
    const reach = k % 2 ? 4 : 8.5;
    star.lineTo(x + reach * Math.cos((k * Math.PI) / 8), y + reach * Math.sin((k * Math.PI) / 8));
  }
  star.closePath();
  context.fillStyle = colours.burst;
  context.strokeStyle = "#1b1f24";
  context.lineWidth = 1.4;
  context.fill(star);
  context.stroke(star);
}

const NAME_FONT = "600 13px system-ui, sans-serif";

// In pixels, above the one that it names.
function drawName(context, words, [x, y], colour) {
  context.font = NAME_FONT;
  context.textAlign = "center";
  context.lineJoin = "round";
  context.lineWidth = 4;
  context.strokeStyle = transparent(colours.panel, 0.85);
  context.strokeText(words, x, y);
  context.fillStyle = colour;
  context.fillText(words, x, y);
}

// In pixels, from a place to the text that names it.
function drawLeader(context, from, to, colour) {
  context.beginPath();
  context.moveTo(...from);
  context.lineTo(...to);
  context.lineWidth = 1;
  context.strokeStyle = colour;
  context.stroke();
}

function transparent(colour, alpha) {
  return colour + Math.round(255 * alpha).toString(16).padStart(2, "0");
}
