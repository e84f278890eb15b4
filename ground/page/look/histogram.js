// How often delays of each length come, as bars.
import uPlot from 'uplot';
import { bucketOf, BUCKETS } from './latency.js';
import { TICKS_MS } from './waterfall.js';

const said = (bucket) => TICKS_MS.find((ms) => bucketOf(ms) === bucket);

export class Histogram {
  #place;
  #ink;
  #plot = null;
  #theme = '';

  constructor(place, ink) {
    this.#place = place;
    this.#ink = ink;
    const sheet = document.createElement('link');
    Object.assign(sheet, { rel: 'stylesheet', href: '/page/lib/uPlot.min.css' });
    document.head.append(sheet);
  }

  /// `shares`: of each bucket.
  draw(shares) {
    const { clientWidth: width, clientHeight: height } = this.#place;
    if (!width || !height) return;
    if (this.#theme !== this.#ink('text')) {
      this.#theme = this.#ink('text');
      this.#plot?.destroy();
      this.#plot = null;
    }
    const data = [shares.map((_, bucket) => bucket), shares.map((share) => 100 * share)];
    if (!this.#plot) this.#plot = new uPlot(this.#options(width, height), data, this.#place);
    else this.#plot.setData(data);
    if (this.#plot.width !== width || this.#plot.height !== height) this.#plot.setSize({ width, height });
  }

  #options(width, height) {
    const look = { stroke: this.#ink('muted'), font: '11px system-ui, sans-serif', grid: { stroke: this.#ink('grid'), width: 1 }, ticks: { show: false } };
    return {
      width,
      height,
      padding: [6, 16, 0, 0],
      legend: { show: false },
      cursor: { show: false },
      scales: { x: { time: false, range: () => [-0.6, BUCKETS - 0.4] }, y: { range: (_plot, _low, high) => [0, Math.max(10, high)] } },
      axes: [
        { ...look, size: 18, gap: 2, splits: () => TICKS_MS.map(bucketOf), values: (_plot, at) => at.map((bucket) => (said(bucket) < 1000 ? `${said(bucket)}` : `${said(bucket) / 1000} s`)) },
        { ...look, size: 38, gap: 3, space: 24, values: (_plot, at) => at.map((share) => `${share} %`) },
      ],
      series: [{}, { fill: this.#ink('accent'), stroke: this.#ink('accent'), width: 0, points: { show: false }, paths: uPlot.paths.bars({ size: [0.85] }) }],
    };
  }
}
