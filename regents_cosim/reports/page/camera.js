// --- Camera: which part of the map is seen; metres with y up to pixels with y down ---

const CLOSEST = 60, FARTHEST = 0.8; // [px/m]

class Camera {
  constructor() {
    Object.assign(this, { x: 0, y: 0, scale: 8, width: 1, height: 1, following: true, zoomed: false });
  }

  // Keeps the ego in the middle, as close as it can without losing the adversary, until somebody zooms.
  follow(ego, adversary) {
    if (!this.following || !ego) return;
    Object.assign(this, { x: ego.x, y: ego.y });
    if (this.zoomed) return;
    const reach = adversary ? Math.hypot(adversary.x - ego.x, adversary.y - ego.y) + 6 : 25;
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
