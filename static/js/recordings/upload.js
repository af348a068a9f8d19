/**
 * A file on its way to the server, with how far it is; fetch cannot tell, XMLHttpRequest can.
 *
 * Exports
 *   sendFile(path, file, changed) -> {ended: Promise<plain data | null>, cancel()}
 *     changed({sent, total, reading}) [bytes]; reading: all is sent and the server reads it
 *     ended: the answer, null once cancelled; rejects with an ApiError
 */

import { address, noAnswer, refusal } from "../lib/api.js";

export function sendFile(path, file, changed) {
  const request = new XMLHttpRequest();
  const ended = new Promise((resolve, reject) => {
    request.upload.addEventListener("progress", ({ loaded, total }) =>
      changed({ sent: loaded, total, reading: false }),
    );
    request.upload.addEventListener("load", () =>
      changed({ sent: file.size, total: file.size, reading: true }),
    );
    request.addEventListener("abort", () => resolve(null));
    request.addEventListener("error", () => reject(noAnswer()));
    request.addEventListener("load", () => {
      const answer = request.response ?? {};
      if (request.status >= 200 && request.status < 300) resolve(answer);
      else reject(refusal(request.status, { title: request.statusText, ...answer }));
    });
  });
  request.open("POST", address(path));
  request.responseType = "json";
  request.setRequestHeader("Accept", "application/json, application/problem+json");
  request.setRequestHeader("Content-Type", "application/octet-stream");
  request.send(file);
  return { ended, cancel: () => request.abort() };
}
