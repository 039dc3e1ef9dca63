// Browsers run no workers for pages that are opened as files. There, the search's worker runs in a hidden frame instead.
"use strict";

if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(address) {
      super();
      this.waiting = [];
      this.frame = document.createElement("iframe");
      this.frame.hidden = true;
      this.frame.srcdoc = "<!doctype html>";
      this.frame.onload = () => this.load(new URL(address, document.baseURI));
      document.documentElement.append(this.frame);
    }

    load(address) {
      const inside = this.frame.contentWindow;
      inside.postMessage = (data) => queueMicrotask(() => this.hand("message", { data }));
      const script = inside.document.createElement("script");
      script.src = address;
      script.onerror = () => this.hand("error", {});
      script.onload = () => {
        this.deliver = (data) => setTimeout(() => inside.dispatchEvent(new MessageEvent("message", { data })));
        this.waiting.forEach(this.deliver);
      };
      inside.document.head.append(script);
    }

    hand(kind, values) {
      const event = new MessageEvent(kind, values);
      this[`on${kind}`]?.(event);
      this.dispatchEvent(event);
    }

    postMessage(data) { this.deliver ? this.deliver(data) : this.waiting.push(data); }

    terminate() { this.frame.remove(); }
  };
}
