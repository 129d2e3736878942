// A short tone when a measurement is taken, a lower one when it has no position.

let context = null;
let on = recall("sound") !== "off";

export function recall(key) {
  try { return localStorage.getItem(`armd.${key}`); } catch { return null; }
}

export function keep(key, value) {
  try { localStorage.setItem(`armd.${key}`, value); } catch { /* private windows keep nothing */ }
}

/** Browsers let a page be heard only after its user has touched it. */
function wake() {
  if (!on) return;
  context ??= new AudioContext();
  if (context.state === "suspended") context.resume();
}

export const isOn = () => on;

export function toggle() {
  on = !on;
  keep("sound", on ? "on" : "off");
  if (on) { wake(); play(true); }
  return on;
}

export function play(good) {
  window.dispatchEvent(new CustomEvent("armd-sound", { detail: { good, on } }));
  if (!on || context?.state !== "running") return;
  const now = context.currentTime;
  for (const [at, hertz] of good ? [[0, 1174]] : [[0, 311], [0.16, 247]]) {
    const tone = context.createOscillator();
    const volume = context.createGain();
    tone.frequency.value = hertz;
    volume.gain.setValueAtTime(0.0001, now + at);
    volume.gain.exponentialRampToValueAtTime(0.25, now + at + 0.008);
    volume.gain.exponentialRampToValueAtTime(0.0001, now + at + 0.14);
    tone.connect(volume).connect(context.destination);
    tone.start(now + at);
    tone.stop(now + at + 0.16);
  }
}

for (const gesture of ["pointerdown", "keydown"]) window.addEventListener(gesture, wake);
