/**
 * The tones: a warning's is interrupted and sounds until acknowledged, a caution's is steady and sounds once.
 * (Interrupted tones are noticed more often.) Both can be muted; the button always shows whether they sound.
 *
 * A browser blocks sound until the user touches the page. The mute button shows that state (`blocked`): a
 * crew must know that an alert would make no sound.
 *
 * createTone({Context}) -> Tone     Context: AudioContext
 *   start(), stop()    sound the alert, again and again, until its acknowledgement
 *   caution()     the steady tone, once; not while it or a warning sounds
 *   setMuted(boolean), unlock()    unlock must be called from a click or key
 *   muted, sounding, state -> "on" | "muted" | "blocked" | "unavailable"
 *   subscribe(listener) -> unsubscribe    called when its state may have changed
 * SOUND_WORDS    by state
 * bindMuteButton(button, tone, signal)    until its abort: it follows the tone, and the first touch of the page unlocks that
 */

import { remember, remembered } from "../lib/storage.js";

const KEY = "forewarn.muted";
const PERIOD = 1.5; // s
const BEEPS = [[0, 880], [0.22, 660], [0.44, 880], [0.66, 660]]; // start [s], pitch [Hz]
const LENGTH = 0.18; // s
const STEADY = [[0, 440]]; // of a caution
const STEADY_LENGTH = 1.2; // s
const RAMP = 0.012; // s, against clicks
export const SOUND_WORDS = {
  on: "Sound on",
  muted: "Muted",
  blocked: "Sound blocked",
  unavailable: "No sound here",
};

export function createTone({ Context = globalThis.AudioContext } = {}) {
  const listeners = new Set();
  let context = null;
  let volume = null;
  let pattern = null; // of a warning
  let steady = null; // of a caution
  let playing = null;
  let steadyUntil = 0; // by the context's clock [s]

  const tone = {
    muted: remembered(KEY) === "true",
    sounding: false,
    get state() {
      if (Context === undefined) return "unavailable";
      if (tone.muted) return "muted";
      return context !== null && context.state === "running" ? "on" : "blocked";
    },
    start,
    stop,
    caution,
    setMuted,
    unlock,
    subscribe: (listener) => {
      listeners.add(listener);
      return () => listeners.delete(listener);
    },
  };

  function changed() {
    for (const listener of listeners) listener(tone);
  }

  function prepare() {
    if (context !== null || Context === undefined) return context !== null;
    context = new Context();
    context.addEventListener("statechange", changed);
    volume = context.createGain();
    volume.gain.value = tone.muted ? 0 : 1;
    volume.connect(context.destination);
    pattern = writePattern(context, BEEPS, LENGTH);
    steady = writePattern(context, STEADY, STEADY_LENGTH);
    return true;
  }

  function unlock() {
    if (prepare() && context.state === "suspended") context.resume().then(changed, changed);
  }

  function start() {
    if (tone.sounding) return;
    tone.sounding = true;
    if (prepare()) {
      playing = play(pattern, volume, true);
      unlock(); // works once the page was touched
    }
    changed();
  }

  function stop() {
    playing?.stop();
    playing = null;
    tone.sounding = false;
    changed();
  }

  function caution() {
    if (tone.sounding || !prepare() || context.currentTime < steadyUntil) return;
    steadyUntil = context.currentTime + STEADY_LENGTH;
    play(steady, volume, false);
    unlock();
  }

  function play(buffer, destination, loop) {
    const source = context.createBufferSource();
    source.buffer = buffer;
    source.loop = loop;
    source.connect(destination);
    source.start();
    return source;
  }

  function setMuted(muted) {
    tone.muted = muted;
    remember(KEY, String(muted));
    if (volume !== null) volume.gain.value = muted ? 0 : 1;
    changed();
  }

  return tone;
}

export function bindMuteButton(button, tone, signal) {
  const show = () => {
    button.textContent = SOUND_WORDS[tone.state];
    button.dataset.sound = tone.state;
    button.setAttribute("aria-pressed", String(tone.muted));
    button.setAttribute("aria-label", `Alert tone: ${SOUND_WORDS[tone.state]}. Press to change.`);
  };
  const press = () => {
    if (tone.state === "blocked") tone.unlock();
    else tone.setMuted(!tone.muted);
    tone.unlock();
  };
  const touch = (event) => {
    if (!button.contains(event.target)) tone.unlock();
  };
  button.addEventListener("click", press);
  for (const kind of ["pointerdown", "keydown"]) addEventListener(kind, touch, { signal });
  signal.addEventListener("abort", tone.subscribe(show));
  show();
}

function writePattern(context, beeps, length) {
  const rate = context.sampleRate;
  const buffer = context.createBuffer(1, Math.round(PERIOD * rate), rate);
  const samples = buffer.getChannelData(0);
  for (const [start, pitch] of beeps) {
    const begin = Math.round(start * rate);
    for (let i = 0; i < length * rate; i++) {
      const t = i / rate;
      const edge = Math.min(1, t / RAMP, (length - t) / RAMP);
      const wave = Math.sin(2 * Math.PI * pitch * t) + 0.35 * Math.sin(6 * Math.PI * pitch * t);
      samples[begin + i] = 0.45 * edge * wave; // the third harmonic carries through headsets and fans
    }
  }
  return buffer;
}
