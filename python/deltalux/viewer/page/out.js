// Out of the page: pictures, sessions, what reproduces them as text, and a video of the canvas.

import { $, download, pressed } from "./dom.js";

const MEDIA = ["video/webm;codecs=vp9", "video/webm;codecs=vp8", "video/mp4"];
const RATE = 60;
const BITS = 12e6;
// What of this page's own view goes into a session.
const KEPT = ["exposure", "locked", "tone", "mode", "wipe", "with", "at", "luminance", "zebra", "full"];
// The largest message that a server takes, with room for what is around it.
const LARGEST = 250 * 1024;

export function mountOut(app) {
  const view = () => app.view.values;
  const savePicture = (kind) => () => app.send({ save: { kind, exposure: view().exposure, tone: view().tone } });
  $("save-png").onclick = savePicture("png");
  $("save-exr").onclick = savePicture("exr");
  $("save-session").onclick = () => {
    const kept = Object.fromEntries(KEPT.map((name) => [name, view()[name]]));
    app.send({ save: { kind: "session", view: { ...kept, clip: thinned(app.clip()) } } });
  };
  $("copy-python").onclick = () => app.send({ save: { kind: "python" } });
  $("copy-command").onclick = () => app.send({ save: { kind: "command" } });
  $("open-session").onclick = () => $("session-file").click();
  $("session-file").onchange = async ({ target }) => {
    const [file] = target.files;
    target.value = "";
    if (!file) return;
    if (file.size > LARGEST) return app.say(`${file.name} has more than ${LARGEST >> 10} KiB, too many to open.`);
    try {
      app.send({ open: JSON.parse(await file.text()) });
    } catch {
      app.say(`${file.name} is not JSON.`);
    }
  };
  app.on("welcome", () => ($("copy-command").hidden = !app.compares));
  app.on("opened", (saved) => {
    const known = Object.fromEntries(Object.entries(saved).filter(([name]) => KEPT.includes(name)));
    app.view.set(known);
    if (saved.clip) app.takeClip(saved.clip);
  });
  app.on("file", ({ name, media }, bytes) => download(bytes, name, media));
  app.on("text", ({ kind, text }) => copy(kind, text));
  mountVideo(app);

  async function copy(kind, text) {
    try {
      await navigator.clipboard.writeText(text);
      app.say(kind === "python" ? "Copied as Python." : "Copied as a command.");
    } catch {
      // Without leave to the clipboard, the text is shown to be copied by hand.
      $("text-body").value = text;
      $("text").showModal();
      $("text-body").select();
    }
  }
}

/** A clip of so few samples that it fits into a message: what lies between two is interpolated. */
function thinned(clip) {
  let { samples } = clip;
  const last = samples.length - 1;
  for (let step = 2; JSON.stringify(samples).length > LARGEST / 2; step *= 2) {
    samples = clip.samples.filter((_, k) => k % step === 0 || k === last);
  }
  return { ...clip, samples };
}

function mountVideo(app) {
  const media = MEDIA.find((one) => window.MediaRecorder?.isTypeSupported(one));
  $("video").hidden = !media;
  let recorder = null;
  $("video").onclick = () => {
    if (recorder) return recorder.stop();
    const chunks = [];
    recorder = new MediaRecorder($("picture").captureStream(RATE), { mimeType: media, videoBitsPerSecond: BITS });
    recorder.ondataavailable = ({ data }) => chunks.push(data);
    recorder.onstop = async () => {
      recorder = null;
      show(false);
      const ending = media.includes("webm") ? "webm" : "mp4";
      download(await new Blob(chunks).arrayBuffer(), `${app.welcome.title.replace(/\.\w+$/, "")}.${ending}`, media);
    };
    recorder.start(1000);
    show(true);
    app.redraw();
  };
  const show = (on) => {
    pressed($("video"), on);
    $("video").textContent = on ? "■ Stop video" : "Video";
  };
}
