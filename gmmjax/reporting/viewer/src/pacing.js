// How many points a frame has, so that the view can be turned without waiting.

// Milliseconds of a frame while the camera moves: 25 frames a second.
export const FRAME = 40;
// Points of a frame while the camera moves: until frames have been timed, and at least.
const FIRST = 100000;
const FEWEST = 12000;
// So many times as many while nothing moves, before all are drawn.
const STILL_FACTOR = 4;
// Where even fewer points take too long, as without a graphics card, the picture has fewer pixels as well: in steps, as
// one of another size takes time to set up.
const AT_FULL_SIZE = 120000;
const RESOLUTIONS = [1, 0.71, 0.5, 0.35];
// From one frame to the next their number changes at most by these factors.
const SLOWER = 0.25;
const FASTER = 1.6;
// Frames that are further apart were not asked for in between.
const PAUSE = 250;

export class Pacing {
  pointsPerFrame = FIRST;
  #last = null;

  /** Which share of the points is drawn, and at which share of the width and height. */
  plan(total, moving) {
    const most = this.pointsPerFrame * (moving ? 1 : STILL_FACTOR);
    const share = Math.min(1, most / Math.max(total, 1));
    const size = Math.sqrt(most / AT_FULL_SIZE);
    const resolution = share < 1 ? (RESOLUTIONS.find((step) => step <= size) ?? RESOLUTIONS.at(-1)) : 1;
    return { share, resolution };
  }

  /** A frame began at `now`, had this share of the points and took so long; while nothing moves frames tell nothing. */
  drawn({ took, now, share, moving }) {
    const since = moving && this.#last !== null ? now - this.#last : 0;
    this.#last = moving ? now : null;
    if (!moving) return;
    // The browser itself needs a fifth.
    const frame = Math.max(took, since < PAUSE ? 0.8 * since : 0, 1);
    const factor = Math.min(FASTER, Math.max(SLOWER, (0.8 * FRAME) / frame));
    if (share < 1 || factor < 1) this.pointsPerFrame = Math.max(FEWEST, this.pointsPerFrame * factor);
  }
}
