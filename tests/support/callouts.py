"""Make the spoken callouts of the page: `python -m tests.support.callouts`.

espeak-ng (apt-get install espeak-ng) synthesises each word by formants, without recordings of a
person; what it says is free of its licence. Silence is cut, the level set, and the rate lowered to
what a headset carries.
"""

import io
import subprocess
import wave
from pathlib import Path

import numpy as np

VOICE = Path("static/js/fly/alarms/voice")
WORDS = ("alert", "limit", "abort", "stale")
RATE = 16_000  # Hz
QUIET = 0.02  # share of the loudest sample
PEAK = 0.85  # of full scale


def spoken(word: str) -> np.ndarray:
    """Samples of a word at RATE, without silence before and after it."""
    command = ["espeak-ng", "-v", "en-us", "-s", "150", "-a", "180", "--stdout", f"{word}!"]
    told = subprocess.run(command, capture_output=True, check=True).stdout
    with wave.open(io.BytesIO(told)) as file:
        rate = file.getframerate()
        samples = np.frombuffer(file.readframes(file.getnframes()), "<i2").astype(float)
    loud = np.flatnonzero(np.abs(samples) > QUIET * np.abs(samples).max())
    heard = samples[loud[0] : loud[-1] + 1]
    smooth = np.convolve(
        heard, np.hanning(5)[1:-1] / 2, "same"
    )  # against frequencies above RATE / 2
    times = np.arange(0, len(smooth), rate / RATE)
    return np.interp(times, np.arange(len(smooth)), smooth)


def main() -> None:
    VOICE.mkdir(exist_ok=True)
    for word in WORDS:
        samples = spoken(word)
        with wave.open(str(VOICE / f"{word}.wav"), "wb") as file:
            file.setparams((1, 2, RATE, len(samples), "NONE", ""))
            file.writeframes((samples / np.abs(samples).max() * PEAK * 32767).astype("<i2"))


if __name__ == "__main__":
    main()
