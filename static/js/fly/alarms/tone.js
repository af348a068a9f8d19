/**
 * The tones: a warning's is interrupted and sounds until acknowledged, a caution's is steady and sounds once.
 * (Interrupted tones are noticed more often.) Both can be muted; the button always shows whether they sound.
 *
 * Where the user chooses the voice, a spoken word follows the tone: a CALLOUT, made by tests/support/callouts.py.
 *
 * A browser blocks sound until the user touches the page. The mute button shows that state (`blocked`): a
 * crew must know that an alert would make no sound.
 *
 * createTone({Context}) -> Tone     Context: AudioContext, or null for silence
 *   start(callout), stop()    sound the alert, again and again, until its acknowledgement
 *   caution(callout)     the steady tone, once; while it or a warning sounds, the word alone
 *   setMuted(boolean), setVoice(boolean), unlock()    unlock must be called from a click or key
 *   callout       the newest one asked for, or ""
 *   voice         whether it is chosen;   hasWords     whether its words could be read: null while that is not known
 *   muted, sounding, state -> "on" | "muted" | "blocked" | "unavailable"
 *   subscribe(listener) -> unsubscribe    called when its state may have changed
 * soundWords(tone)    its state, in words
 * CALLOUTS       that can be spoken; another, or none, is the tone alone
 * bindMuteButton(button, tone, signal)    until its abort: it follows the tone, and the first touch of the page unlocks that
 */

import { remember, remembered } from "../../lib/storage.js";

const KEY = "forewarn.muted";
const VOICE_KEY = "forewarn.voice";
const PERIOD = 1.5; // s
const PAUSE = 0.12; // s before and after a word
export const CALLOUTS = ["alert", "limit", "abort", "stale"];
const BEEPS = [[0, 880], [0.22, 660], [0.44, 880], [0.66, 660]]; // start [s], pitch [Hz]
const LENGTH = 0.18; // s
const STEADY = [[0, 440]]; // of a caution
const STEADY_LENGTH = 1.2; // s
const RAMP = 0.012; // s, against clicks
const SOUND_WORDS = {
  on: "Sound on",
  muted: "Muted",
  blocked: "Sound blocked",
  unavailable: "No sound here",
};

export function soundWords({ state, voice, hasWords }) {
  if (state !== "on" || !voice) return SOUND_WORDS[state];
  return hasWords === false ? "Tone on, no voice" : "Voice on";
}

export function createTone({ Context = globalThis.AudioContext } = {}) {
  const listeners = new Set();
  let context = null;
  let volume = null;
  const words = new Map(); // buffers, by callout
  let playing = null; // warning
  let steadyUntil = 0; // by the context's clock [s]

  const tone = {
    muted: remembered(KEY) === "true",
    voice: remembered(VOICE_KEY) === "true",
    hasWords: null,
    callout: "",
    sounding: false,
    warning: "", // callout of the one that sounds
    get state() {
      if (!Context) return "unavailable";
      if (tone.muted) return "muted";
      return context !== null && context.state === "running" ? "on" : "blocked";
    },
    start,
    stop,
    caution,
    setMuted,
    setVoice,
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
    if (context !== null || !Context) return context !== null;
    context = new Context();
    context.addEventListener("statechange", changed);
    volume = context.createGain();
    volume.gain.value = tone.muted ? 0 : 1;
    volume.connect(context.destination);
    if (tone.voice) readWords();
    return true;
  }

  async function readWords() {
    try {
      await Promise.all(CALLOUTS.map(readWord));
      tone.hasWords = true;
      if (tone.sounding) sound();
    } catch {
      tone.hasWords = false;
    }
    changed();
  }

  async function readWord(name) {
    if (words.has(name)) return;
    const answer = await fetch(new URL(`voice/${name}.wav`, import.meta.url));
    words.set(name, await context.decodeAudioData(await answer.arrayBuffer()));
  }

  const wordOf = (callout) => (tone.voice ? words.get(callout) : undefined);

  function unlock() {
    if (prepare() && context.state === "suspended") context.resume().then(changed, changed);
  }

  function start(callout = "") {
    if (tone.sounding && callout === tone.warning) return;
    Object.assign(tone, { sounding: true, warning: callout, callout });
    if (prepare()) {
      sound();
      unlock(); // works once the page was touched
    }
    changed();
  }

  function sound() {
    playing?.stop();
    playing = play(writePattern(context, BEEPS, LENGTH, wordOf(tone.warning)), true);
  }

  function stop() {
    playing?.stop();
    playing = null;
    tone.sounding = false;
    changed();
  }

  function caution(callout = "") {
    tone.callout = callout;
    changed();
    if (!prepare()) return;
    const word = wordOf(callout);
    if (!tone.sounding && context.currentTime >= steadyUntil) {
      steadyUntil = context.currentTime + STEADY_LENGTH;
      play(writePattern(context, STEADY, STEADY_LENGTH, word), false);
    } else if (word) play(word, false);
    unlock();
  }

  function play(buffer, loop) {
    const source = context.createBufferSource();
    source.buffer = buffer;
    source.loop = loop;
    source.connect(volume);
    source.start();
    return source;
  }

  function setMuted(muted) {
    tone.muted = muted;
    remember(KEY, String(muted));
    if (volume !== null) volume.gain.value = muted ? 0 : 1;
    changed();
  }

  function setVoice(voice) {
    tone.voice = voice;
    remember(VOICE_KEY, String(voice));
    if (voice && context !== null) readWords();
    else if (voice) prepare();
    changed();
  }

  return tone;
}

export function bindMuteButton(button, tone, signal) {
  const show = () => {
    button.textContent = soundWords(tone);
    button.dataset.sound = tone.state;
    button.dataset.callout = tone.callout;
    button.setAttribute("aria-pressed", String(tone.muted));
    button.setAttribute("aria-label", `Alert tone: ${soundWords(tone)}. Press to change.`);
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

/** Beeps, then a word, if given. */
function writePattern(context, beeps, length, word) {
  const rate = context.sampleRate;
  const spoken = beeps.at(-1)[0] + length + PAUSE; // s
  const period = Math.max(PERIOD, word === undefined ? 0 : spoken + word.duration + PAUSE);
  const buffer = context.createBuffer(1, Math.round(period * rate), rate);
  if (word) buffer.copyToChannel(word.getChannelData(0), 0, Math.round(spoken * rate));
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
