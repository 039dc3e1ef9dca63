// The ghost of the plain interpolation: what lies between the keys without the models.
import { Motion } from "./motion.js";

export class Plain {
  constructor() { Object.assign(this, { of: "", motion: null }); }

  // session: as the server gave it; null where the ghost is not seen. load(work) runs work after what is being stored;
  // drawn() is called when points have come.
  look(session, load, drawn) {
    const state = session?.state, { keyframes, parts, keep } = state?.settings.constraints || {};
    const of = keyframes || parts?.length ? JSON.stringify([session.id, state.motion, keyframes, parts, keep]) : "";
    if (of === this.of) return;
    Object.assign(this, { of, motion: null });
    if (of) load(async () => {
      if (this.of !== of) return;
      const motion = await Motion.load(`sessions/${session.id}/plain`, "plain", drawn);
      if (this.of === of) this.motion = motion;
      await motion.ready;
      drawn();
    });
  }
}
