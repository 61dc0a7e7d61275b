// --- Plots over time: lines drawn once, a cursor that moves with the player; press or drag to go there ---

const EDGE = { left: 34, right: 8, top: 8, bottom: 18 };

class TimePlot {
  constructor(canvas, onSeek) {
    this.canvas = canvas;
    this.picture = document.createElement("canvas");
    const seek = (event) => {
      const share = (event.offsetX - EDGE.left) / (canvas.clientWidth - EDGE.left - EDGE.right);
      onSeek(Math.round(Math.min(Math.max(share, 0), 1) * this.last));
    };
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      seek(event);
    });
    canvas.addEventListener("pointermove", (event) => event.buttons && seek(event));
  }

  // lines: [{ stretches: [[[step, value]...]...], colour (a name), dashed, until (a step) }]
  show(lines, last, dt) {
    Object.assign(this, { lines, last, dt });
    this.stale = true;
  }

  draw(step) {
    const { context, width, height, ratio } = sharp(this.canvas);
    if (!width) return;
    if (this.stale || this.picture.width !== this.canvas.width || this.picture.height !== this.canvas.height) {
      this.paint(width, height, ratio);
    }
    context.clearRect(0, 0, width, height);
    context.drawImage(this.picture, 0, 0, width, height);
    const x = this.column(step, width);
    context.fillStyle = colours.ink;
    context.fillRect(x - 0.75, EDGE.top, 1.5, height - EDGE.top - EDGE.bottom);
    for (const line of this.lines) {
      const value = step <= (line.until ?? Infinity) ? valueAt(line.stretches, step) : null;
      if (value === null || line.dashed) continue;
      context.beginPath();
      context.arc(x, this.line(value, height), 3.5, 0, 2 * Math.PI);
      context.fillStyle = colours[line.colour];
      context.fill();
    }
  }

  column(step, width) {
    return EDGE.left + (step / Math.max(this.last, 1)) * (width - EDGE.left - EDGE.right);
  }

  line(value, height) {
    return height - EDGE.bottom - ((value - this.low) / (this.high - this.low)) * (height - EDGE.top - EDGE.bottom);
  }

  paint(width, height, ratio) {
    this.stale = false;
    this.picture.width = this.canvas.width;
    this.picture.height = this.canvas.height;
    const context = this.picture.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    const shown = this.lines.flatMap((line) => line.stretches.flat().filter(([step]) => step <= Math.min(line.until ?? Infinity, this.last)));
    const values = shown.map(([, value]) => value);
    const ticks = niceTicks(Math.min(0, ...values), Math.max(1, ...values), 3);
    [this.low, this.high] = [ticks[0], ticks.at(-1)];
    this.paintAxes(context, width, height, ticks);
    for (const line of this.lines) this.paintLine(context, width, height, line);
    for (const { until } of this.lines) this.paintCrash(context, width, height, until);
  }

  paintCrash(context, width, height, until) {
    if (!Number.isFinite(until)) return;
    context.strokeStyle = colours.faint;
    context.lineWidth = 1;
    context.setLineDash([1, 3]);
    context.beginPath();
    context.moveTo(this.column(until, width), EDGE.top);
    context.lineTo(this.column(until, width), height - EDGE.bottom);
    context.stroke();
    context.setLineDash([]);
  }

  paintAxes(context, width, height, ticks) {
    context.font = "11px system-ui, sans-serif";
    context.fillStyle = colours.faint;
    context.strokeStyle = colours.hairline;
    context.textAlign = "right";
    for (const tick of ticks) {
      const y = Math.round(this.line(tick, height)) + 0.5;
      context.beginPath();
      context.moveTo(EDGE.left, y);
      context.lineTo(width - EDGE.right, y);
      context.stroke();
      context.fillText(String(tick), EDGE.left - 6, y + 4);
    }
    context.textAlign = "center";
    const seconds = this.last * this.dt;
    for (const tick of niceTicks(0, seconds, 5).filter((time) => time <= seconds + 1e-9)) {
      context.fillText(tick === 0 ? "0 s" : String(tick), this.column(tick / this.dt, width), height - 3);
    }
  }

  paintLine(context, width, height, { stretches, colour, dashed, until = Infinity }) {
    context.strokeStyle = colours[colour];
    context.lineWidth = dashed ? 1.25 : 2;
    context.lineJoin = "round";
    context.setLineDash(dashed ? [4, 3] : []);
    for (const stretch of stretches) {
      context.beginPath();
      for (const [step, value] of stretch) {
        if (step <= Math.min(until, this.last)) context.lineTo(this.column(step, width), this.line(value, height));
      }
      context.stroke();
    }
    context.setLineDash([]);
  }
}

// Halfway between two samples the earlier: what led here, not what a crash made of it.
function valueAt(stretches, step) {
  for (const stretch of stretches) {
    const since = step - stretch[0]?.[0];
    if (since < -0.5 || since > stretch.length) continue;
    const k = Math.min(Math.max(Math.ceil(since - 0.5), 0), stretch.length - 1);
    if (k in stretch) return stretch[k][1];
  }
  return null;
}

function niceTicks(low, high, wanted) {
  const rough = (high - low) / wanted;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((share) => share * power).find((size) => size >= rough);
  const first = Math.floor(low / step + 1e-9);
  const last = Math.ceil(high / step - 1e-9);
  return Array.from({ length: last - first + 1 }, (_, k) => Number(((first + k) * step).toPrecision(6)));
}

// A small line without axes.
function sparkline(canvas, values, colour) {
  const { context, width, height } = sharp(canvas);
  const [low, high] = [Math.min(...values), Math.max(...values)];
  context.clearRect(0, 0, width, height);
  context.strokeStyle = colour;
  context.lineWidth = 1.75;
  context.lineJoin = "round";
  context.beginPath();
  values.forEach((value, k) => {
    const x = 2 + (k / Math.max(values.length - 1, 1)) * (width - 4);
    context.lineTo(x, high > low ? height - 4 - ((value - low) / (high - low)) * (height - 8) : height / 2);
  });
  context.stroke();
}
