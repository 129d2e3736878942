// What the server tells, topic by topic; comes back by itself when the server was away.

const PATIENCE_MS = 12000; // the server speaks every five seconds at the latest
const RETRY_MS = 1500;

export function listen(topics, lost) {
  let source = null;
  let heard = 0;
  let retry = 0;

  const open = () => {
    source?.close();
    heard = performance.now();
    source = new EventSource("/events");
    for (const [topic, take] of Object.entries(topics))
      source.addEventListener(topic, (event) => {
        heard = performance.now();
        take(JSON.parse(event.data));
      });
    source.onerror = () => {
      lost();
      if (source.readyState !== EventSource.CLOSED) return; // it tries again by itself
      clearTimeout(retry);
      retry = setTimeout(again, RETRY_MS);
    };
  };

  // A refusal ends an EventSource for good. One for want of the token wants the token's page.
  const again = async () => {
    try {
      const answer = await fetch("/temperatures", { cache: "no-store" });
      if (answer.status === 401) location.reload();
    } catch {
      // not there yet
    }
    open();
  };

  setInterval(() => {
    if (performance.now() - heard < PATIENCE_MS) return;
    lost(); // a cable pulled: nothing ends the connection
    open();
  }, 2000);
  open();
}
