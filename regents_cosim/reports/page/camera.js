// --- Camera: which part of the map is seen; metres with y up to pixels with y down ---

const CLOSEST = 60, FARTHEST = 0.8; // [px/m]

class Camera {
  constructor() {
    Object.assign(this, { x: 0, y: 0, scale: 8, width: 1, height: 1, following: true });
  }

  // Close enough that whoever is `reach` metres away is seen as well.
  frame(reach) {
    this.scale = Math.min(Math.max((0.42 * Math.min(this.width, this.height * 1.5)) / Math.max(reach, 1), 4.5), 13);
    this.following = true;
  }

  zoom(factor, px = this.width / 2, py = this.height / 2) {
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
