// --- Camera: which part of the map is seen; metres with y up to pixels with y down ---

const CLOSEST = 60, FARTHEST = 0.8; // [px/m]
const LOST = 60; // [m] between two egos: then the camera stays with the first

class Camera {
  constructor() {
    Object.assign(this, { x: 0, y: 0, scale: 8, width: 1, height: 1, following: true, zoomed: false });
  }

  // Keeps the first ego (of two: their middle, while they are near) in view, as close as it can without losing the
  // others, until the user zooms.
  follow([ego, second], adversary) {
    if (!this.following || !ego) return;
    const apart = second ? Math.hypot(second.x - ego.x, second.y - ego.y) : 0;
    const share = second ? 0.5 * Math.min(1, LOST / Math.max(apart, LOST)) : 0;
    this.x = ego.x + share * (second?.x - ego.x || 0);
    this.y = ego.y + share * (second?.y - ego.y || 0);
    if (this.zoomed) return;
    const others = [ego, second, adversary].filter(Boolean);
    const reach = 8 + Math.max(adversary ? 0 : 17, ...others.map(({ x, y }) => Math.hypot(x - this.x, y - this.y)));
    const half = 0.5 * Math.min(this.width, 1.5 * this.height);
    this.scale = Math.min(Math.max(half / reach, half / 60), half / 30);
  }

  zoom(factor, px = this.width / 2, py = this.height / 2) {
    this.zoomed = true;
    if (this.following) [px, py] = [this.width / 2, this.height / 2];
    const scale = Math.min(Math.max(this.scale * factor, FARTHEST), CLOSEST);
    const [right, up] = [px - this.width / 2, this.height / 2 - py];
    this.x += right / this.scale - right / scale;
    this.y += up / this.scale - up / scale;
    this.scale = scale;
  }

  pan(right, down) {
    this.x -= right / this.scale;
    this.y += down / this.scale;
    this.following = false;
  }

  pixels(x, y) {
    return [this.width / 2 + (x - this.x) * this.scale, this.height / 2 - (y - this.y) * this.scale];
  }

  // From now on `context` draws in metres.
  enter(context, ratio) {
    const scale = this.scale * ratio;
    const [x, y] = this.pixels(0, 0);
    context.setTransform(scale, 0, 0, -scale, x * ratio, y * ratio);
  }
}
