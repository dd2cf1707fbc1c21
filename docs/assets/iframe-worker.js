/* Search in pages opened as files: browsers start no worker there, so a hidden frame runs the worker's script. */
if (location.protocol === "file:")
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      this.waiting = []; // messages until the script is there
      const frame = document.createElement("iframe");
      frame.hidden = true;
      frame.srcdoc = "<!doctype html>";
      frame.onload = () => {
        const inner = (this.inner = frame.contentWindow);
        const load = (src) =>
          new Promise((done, failed) => {
            const script = inner.document.createElement("script");
            Object.assign(script, { src, onload: done, onerror: failed });
            inner.document.head.append(script);
          });
        inner.postMessage = (data) => this.dispatchEvent(new MessageEvent("message", { data }));
        inner.importScripts = (...all) => all.reduce((before, src) => before.then(() => load(src)), Promise.resolve());
        load(url).then(() => {
          for (const data of this.waiting.splice(0)) this.hand(data);
          this.waiting = undefined;
        });
      };
      this.frame = frame;
      document.documentElement.append(frame);
    }
    hand(data) {
      this.inner.dispatchEvent(new this.inner.MessageEvent("message", { data }));
    }
    postMessage(data) {
      if (this.waiting) this.waiting.push(data);
      else this.hand(data);
    }
    terminate() {
      this.frame.remove();
    }
  };
