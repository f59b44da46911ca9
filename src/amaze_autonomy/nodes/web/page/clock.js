// The page's clock, a worker: browsers let the timers of a page that is not in front stand for up to a minute, not these.
"use strict";

onmessage = ({ data: everyMs }) => setInterval(() => postMessage(null), everyMs);
