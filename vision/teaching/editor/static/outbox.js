// Acts of the person on their way to the server: none is lost, none is done twice.

const RESEND_MS = 1500;

/** A queue that survives a lost connection and a reload; an act leaves it when the server has stored it. */
export class Outbox {
  constructor(name, send) {
    this.key = `focalpick-outbox-${name}`;
    this.send = send;
    this.acts = JSON.parse(sessionStorage.getItem(this.key) || "[]");
    this.timer = undefined;
    if (this.acts.length) this.flush();
  }

  push(act) {
    const unique = `${Date.now().toString(36)}-${Math.random().toString(36).slice(2, 10)}`;
    const entry = { ...act, uid: unique, sent_ms: performance.now() };
    this.acts.push(entry);
    this.store();
    this.send([entry]);
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.flush(), RESEND_MS);
  }

  acknowledge(uids) {
    const done = new Set(uids);
    const finished = this.acts.filter((act) => done.has(act.uid));
    this.acts = this.acts.filter((act) => !done.has(act.uid));
    this.store();
    if (!this.acts.length) clearTimeout(this.timer);
    return finished;
  }

  /** All of them, oldest first: the server leaves out those it knows. */
  flush() {
    this.store();
    clearTimeout(this.timer);
    if (!this.acts.length) return;
    this.send(this.acts);
    this.timer = setTimeout(() => this.flush(), RESEND_MS);
  }

  store() {
    sessionStorage.setItem(this.key, JSON.stringify(this.acts));
  }
}
