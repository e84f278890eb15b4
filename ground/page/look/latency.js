// What is known of delays: samples by the second, counted into buckets that grow by a third of an octave. No page in here.

export const SPAN_S = 120;
const MAX_A_SECOND = 600; // samples of one kind: 30 states a second of twenty drones
const FIRST_MS = 10;
export const BUCKETS = 31; // below 10 ms, then up to 10 s and more

/// Where bucket `i` begins, ms.
export const bucketFrom = (i) => (i === 0 ? 0 : FIRST_MS * 2 ** ((i - 1) / 3));
export const bucketOf = (ms) => (ms < FIRST_MS ? 0 : Math.min(BUCKETS - 1, 1 + Math.floor(3 * Math.log2(ms / FIRST_MS) + 1e-9)));

/// The smallest of the sorted values that `share` of them do not exceed.
export const quantile = (sorted, share) => sorted[Math.max(0, Math.ceil(share * sorted.length) - 1)];

/// Kinds of delays over the last two minutes.
export class Latency {
  #seconds = []; // {s, kinds: {kind: [ms]}}, oldest first

  /// `kinds`: {kind: [ms, ...]} at one moment.
  add(now, kinds) {
    const s = Math.floor(now / 1000);
    if (this.#seconds.at(-1)?.s !== s) this.#seconds.push({ s, kinds: {} });
    const held = this.#seconds.at(-1).kinds;
    for (const [kind, values] of Object.entries(kinds)) {
      held[kind] ??= [];
      for (const ms of values) if (held[kind].length < MAX_A_SECOND) held[kind].push(ms);
    }
    while (this.#seconds[0].s <= s - SPAN_S) this.#seconds.shift();
  }

  /// All of the last `span_s` seconds, sorted.
  sorted(kind, now, span_s) {
    const from = Math.floor(now / 1000) - span_s;
    return this.#seconds.filter((each) => each.s > from).flatMap((each) => each.kinds[kind] ?? []).sort((a, b) => a - b);
  }

  /// For each second that has some: {ago_s, shares: of its samples in each bucket}.
  columns(kind, now) {
    const s = Math.floor(now / 1000);
    return this.#seconds.filter((each) => each.kinds[kind]?.length).map((each) => ({ ago_s: s - each.s, shares: shares(each.kinds[kind]) }));
  }
}

/// Which share of the values lies in each bucket.
export function shares(values) {
  const counts = new Array(BUCKETS).fill(0);
  for (const ms of values) counts[bucketOf(ms)] += 1 / values.length;
  return counts;
}
