// --- Player: the clock, and the scene at its time ---

const TAIL_SECONDS = 1;
const SAME_METRES = 1; // closer than that a ghost would only blur who it belongs to
const AFTER_CRASH_SECONDS = 1; // later motion means nothing: what a crash does is not computed

class Player {
  constructor(canvas, onChange) {
    Object.assign(this, { canvas, onChange, camera: new Camera(), step: 0, speed: 1, playing: false, hidden: new Set() });
    this.watchPointer();
    new ResizeObserver(() => this.draw()).observe(canvas);
  }

  // A case as unpacked, its row of the table, and the ground it takes place on.
  open(content, row, ground) {
    Object.assign(this, { content, row, ground, playing: false });
    this.tracks = [null, ...content.tracks.map((spans) => new Track(spans))];
    this.runs = content.runs.map((spans, index) => ({
      track: new Track(spans),
      crash: row.endings[index]?.step ?? Infinity,
      mark: content.contacts[index] && content.contacts[index].map((value, axis) => value - content.origin[axis]),
      colour: DRIVERS[index],
    }));
    this.driven = this.runs.filter((run) => run.track.stretches.length);
    this.adversary = content.adversary;
    const log = Object.entries(content.log ?? {});
    this.log = new Map(log.map(([index, spans]) => [Number(index), new Track(spans)]));
    this.evasion = content.evasion && new Track(content.evasion);
    this.last = this.lastStep();
    const crashes = this.runs.map((run) => run.crash).filter(Number.isFinite);
    this.crash = crashes.length ? Math.min(...crashes) : null;
    this.atRest = true;
    this.step = this.crash ?? 0;
    Object.assign(this.camera, { following: true, zoomed: false });
    this.draw();
  }

  // Shortly after the last crash, or the end where one gets by.
  lastStep() {
    const end = Math.max(this.row.steps - 1, 1);
    if (this.evasion || !this.driven.length || this.driven.some((run) => run.crash === Infinity)) return end;
    return Math.min(Math.max(...this.driven.map((run) => run.crash)) + Math.round(AFTER_CRASH_SECONDS / this.row.dt), end);
  }

  // Who the camera follows: the egos that were driven at all, or else any.
  targets(step) {
    if (this.driven.length) return this.driven.map((run) => run.track.at(Math.min(step, run.crash)));
    return [this.tracks.find((track) => track?.at(step))?.at(step) ?? null];
  }

  // --- the clock ---

  play() {
    if (this.playing || !this.content) return;
    if (this.step >= this.last || this.atRest) this.step = 0;
    this.playing = true;
    this.atRest = false;
    let before = null;
    const tick = (now) => {
      if (!this.playing) return;
      if (before !== null) this.step = Math.min(this.step + (this.speed * (now - before)) / 1000 / this.row.dt, this.last);
      before = now;
      if (this.step >= this.last) this.playing = false;
      this.draw();
      this.onChange();
      if (this.playing) requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
    this.onChange();
  }

  pause() {
    if (!this.playing) return;
    this.playing = false;
    this.seek(Math.round(this.step));
  }

  toggle() {
    if (this.playing) this.pause();
    else this.play();
  }

  seek(step) {
    this.atRest = false;
    this.step = Math.min(Math.max(step, 0), this.last);
    this.draw();
    this.onChange();
  }

  move(steps) {
    this.playing = false;
    this.seek(Math.round(this.step) + steps);
  }

  // --- the scene ---

  draw() {
    if (!this.content || !this.canvas.clientWidth) return;
    const { context, width, height, ratio } = sharp(this.canvas);
    Object.assign(this.camera, { width, height });
    this.camera.follow(this.targets(this.step), this.adversaryPose());
    context.fillStyle = colours.land;
    context.fillRect(0, 0, width, height);
    const pixel = 1 / this.camera.scale;
    this.camera.enter(context, ratio);
    this.ground.draw(context, pixel);
    this.ground.drawLights(context, pixel, this.content.signals, Math.floor(this.step + 1e-6));
    this.drawWays(context, pixel);
    this.drawThoughts(context, pixel);
    this.drawOthers(context, pixel);
    this.drawMarks(context, pixel);
    this.drawGhosts(context, pixel);
    this.drawMain(context, pixel);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.drawWords(context, height);
  }

  shows(layer) {
    return !this.hidden.has(layer);
  }

  // The adversary stands still with the crash, unless another is still on the way past it.
  adversaryStep() {
    const over = this.driven.length && this.driven.every((run) => run.crash <= this.step);
    if (!over || (this.evasion && this.shows("evasion"))) return this.step;
    return Math.max(...this.driven.map((run) => run.crash));
  }

  adversaryPose() {
    return this.adversary === null ? null : this.tracks[this.adversary].at(this.adversaryStep());
  }

  drawWays(context, pixel) {
    if (this.shows("log")) {
      for (const [index, track] of this.log) {
        const colour = colours[index ? "adversary" : "ego"];
        drawPath(context, track.path(0, this.last), transparent(colour, 0.65), 1.5 * pixel, [7 * pixel, 5 * pixel]);
      }
    }
    if (!this.shows("trails")) return;
    const dots = (track, until, colour) => drawSeconds(context, pixel, track, until, Math.round(1 / this.row.dt), colour);
    if (this.evasion && this.shows("evasion")) {
      drawPath(context, this.evasion.path(0, this.step), transparent(colours.evasion, 0.8), 2 * pixel);
    }
    if (this.adversary !== null) {
      drawPath(context, this.tracks[this.adversary].path(0, this.adversaryStep()), transparent(colours.adversary, 0.8), 2.5 * pixel);
      dots(this.tracks[this.adversary], this.adversaryStep(), colours.adversary);
    }
    for (const run of this.driven) {
      drawPath(context, run.track.path(0, Math.min(this.step, run.crash)), transparent(colours[run.colour], 0.8), 2.5 * pixel);
      dots(run.track, Math.min(this.step, run.crash), colours[run.colour]);
    }
  }

  drawOthers(context, pixel) {
    const since = this.step - TAIL_SECONDS / this.row.dt;
    this.tracks.forEach((track, index) => {
      const pose = track && index !== this.adversary && track.at(this.step);
      if (!pose) return;
      if (this.shows("trails")) drawPath(context, track.path(since, this.step), transparent(colours.other, 0.5), 2 * pixel);
      drawBody(context, pixel, pose, this.content.agents[index], colours.other);
    });
  }

  marks() {
    return this.content.marks.filter(({ step, colour }) => step <= this.step && (colour !== "evasion" || this.shows("evasion")));
  }

  // What the planners thought at this step: the paths that they weighed, expected and took.
  thoughts() {
    if (!this.shows("debug")) return [];
    return this.content.debug.map((steps) => steps[Math.floor(this.step + 1e-6)]).filter(Boolean);
  }

  drawThoughts(context, pixel) {
    for (const { candidates, costs, chosen, predictions } of this.thoughts()) {
      const dearest = [...candidates.keys()].sort((a, b) => (costs[b] ?? 0) - (costs[a] ?? 0));
      dearest.forEach((k, rank) => {
        const strength = 0.25 + (0.4 * rank) / Math.max(dearest.length - 1, 1);
        drawPath(context, [points(candidates[k])], transparent(colours.second, strength), 1.25 * pixel);
      });
      for (const path of predictions) drawPath(context, [points(path)], colours.faint, 1.5 * pixel, [3 * pixel, 4 * pixel]);
      if (chosen) drawPath(context, [points(chosen)], colours.second, 3 * pixel);
    }
  }

  drawMarks(context, pixel) {
    for (const mark of this.marks()) drawRoadMark(context, pixel, mark, colours[mark.colour]);
  }

  drawGhosts(context, pixel) {
    const agents = this.content.agents;
    for (const [index, track] of this.shows("log") ? this.log : []) {
      const pose = track.at(this.step);
      const now = index ? this.adversaryPose() : this.targets(this.step)[0];
      const same = pose && now && Math.hypot(now.x - pose.x, now.y - pose.y) < SAME_METRES;
      const colour = colours[index ? "adversary" : "ego"];
      if (pose && !same) drawBody(context, pixel, pose, agents[index], colour, { ghost: 0.1, dashed: true });
    }
    const way = this.evasion && this.shows("evasion") && this.evasion.at(this.step);
    if (way) drawBody(context, pixel, way, agents[0], colours.evasion, { ghost: 0.3 });
  }

  drawMain(context, pixel) {
    const agents = this.content.agents;
    const other = this.adversaryPose();
    if (other) drawBody(context, pixel, other, agents[this.adversary], colours.adversary);
    for (const run of [...this.driven].reverse()) {
      const pose = run.track.at(Math.min(this.step, run.crash));
      const gone = this.step - run.crash > AFTER_CRASH_SECONDS / this.row.dt;
      if (pose) drawBody(context, pixel, pose, agents[0], colours[run.colour], { alpha: gone ? 0.45 : 1 });
    }
  }

  // In pixels: marks of collisions, names, and how long some metres are.
  drawWords(context, height) {
    for (const run of this.driven) {
      if (run.crash <= this.step) drawMark(context, this.camera.pixels(...run.mark), (this.step - run.crash) * this.row.dt);
    }
    if (this.shows("names")) this.drawNames(context);
    const metres = [1, 2, 5, 10, 20, 50, 100, 200].find((length) => length * this.camera.scale > 50) ?? 500;
    context.fillStyle = colours.ink;
    context.fillRect(16, height - 18, metres * this.camera.scale, 2);
    context.font = "12px system-ui, sans-serif";
    context.textAlign = "left";
    context.fillText(`${metres} m`, 16, height - 24);
    this.thoughts().filter(({ text }) => text).forEach(({ text }, k) => {
      context.fillStyle = colours["second-ink"];
      context.fillText(`planner: ${text}`, 16, height - 44 - 16 * k, this.camera.width - 32);
    });
  }

  // Who is who, how fast, and what the marks mean: each text above or below its place, off the others.
  drawNames(context) {
    context.font = NAME_FONT;
    const named = this.named().filter(([, pose]) => pose);
    const places = named.map(([, { x, y, yaw }, size]) => {
      const [length, width] = size ?? [0, 0];
      const [c, s] = [Math.abs(Math.cos(yaw)), Math.abs(Math.sin(yaw))];
      const [px, py] = this.camera.pixels(x, y);
      return { x: px, y: py, across: 0.5 * (c * length + s * width) * this.camera.scale, up: 0.5 * (s * length + c * width) * this.camera.scale };
    });
    const taken = places.filter((_, k) => named[k][2]);
    const middle = named.reduce((total, [, pose]) => total + pose.y / named.length, 0);
    named.forEach(([words, pose, , colour], k) => {
      const { y, up } = places[k];
      const across = 0.5 * context.measureText(words).width + 3;
      const x = Math.min(Math.max(places[k].x, across), Math.max(this.camera.width - across, across));
      const free = (place) => taken.every((other) => Math.abs(x - other.x) > across + other.across || Math.abs(place - 4 - other.y) > 9 + other.up);
      const away = [0, 1, 2, 3, 4, 5].map((line) => 18 * line);
      const [above, below] = [away.map((more) => y - up - 10 - more), away.map((more) => y + up + 20 + more)];
      const place = (pose.y < middle ? [...below, ...above] : [...above, ...below]).find(free) ?? above[0];
      taken.push({ x, y: place - 4, across, up: 9 });
      if (Math.abs(place - 4 - y) > up + 26) drawLeader(context, [places[k].x, y], [x, place - 4], colours[colour]);
      drawName(context, words, [x, place], colours[`${colour}-ink`]);
    });
  }

  // [words, place, its size where it has one, colour]
  named() {
    const sized = ([words, pose, agent, colour]) => [pose && `${words} ${kmh(pose.speed)}`, pose, this.content.agents[agent].size, colour];
    const found = this.driven.map((run) => [
      this.driven.length > 1 ? this.names[this.runs.indexOf(run)] : "ego", run.track.at(Math.min(this.step, run.crash)), 0, run.colour,
    ]);
    if (this.adversary !== null) found.push(["adversary", this.adversaryPose(), this.adversary, "adversary"]);
    const way = this.evasion && this.shows("evasion") && this.evasion.at(this.step);
    const [ego] = this.targets(this.step);
    if (way && ego && Math.hypot(way.x - ego.x, way.y - ego.y) > 3) found.push(["careful driver", way, 0, "evasion"]);
    return [...found.map(sized), ...this.marks().map((mark) => [mark.words, mark, null, mark.colour])];
  }

  // --- pointer: drag to move the map, two fingers or the wheel to zoom ---

  watchPointer() {
    const fingers = new Map();
    const apart = () => {
      const [a, b] = [...fingers.values()];
      return Math.hypot(a.offsetX - b.offsetX, a.offsetY - b.offsetY);
    };
    this.canvas.addEventListener("pointerdown", (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, event);
    });
    this.canvas.addEventListener("pointermove", (event) => {
      const before = fingers.get(event.pointerId);
      if (!before) return;
      const spread = fingers.size === 2 ? apart() : 0;
      fingers.set(event.pointerId, event);
      if (fingers.size === 2) this.camera.zoom(apart() / Math.max(spread, 1), event.offsetX, event.offsetY);
      else this.camera.pan(event.offsetX - before.offsetX, event.offsetY - before.offsetY);
      this.draw();
      this.onChange();
    });
    for (const end of ["pointerup", "pointercancel"]) {
      this.canvas.addEventListener(end, (event) => fingers.delete(event.pointerId));
    }
    // The wheel scrolls the page until the map was clicked.
    this.canvas.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && document.activeElement !== this.canvas) return;
      event.preventDefault();
      this.zoom(Math.exp(-0.0015 * event.deltaY), event.offsetX, event.offsetY);
    }, { passive: false });
  }

  zoom(factor, x, y) {
    this.camera.zoom(factor, x, y);
    this.draw();
  }

  follow(whether) {
    Object.assign(this.camera, { following: whether, zoomed: false });
    this.draw();
    this.onChange();
  }
}
