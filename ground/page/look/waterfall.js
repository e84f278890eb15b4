// Delays over time as a heat map: seconds to the right, milliseconds upwards, the fuller the more of that second's delays lie there.
import { bucketOf, BUCKETS, SPAN_S } from './latency.js';

export const TICKS_MS = [10, 100, 1000, 10000];
const LEFT = 38;

/// `ctx`: scaled to CSS pixels, of a canvas of that size.
export function drawWaterfall(ctx, width, height, columns, ink) {
  const bottom = height - 16;
  const [wide, tall] = [(width - LEFT) / SPAN_S, (bottom - 6) / BUCKETS];
  const top = (bucket) => bottom - (bucket + 1) * tall;
  ctx.font = '11px system-ui, sans-serif';
  for (const ms of TICKS_MS) {
    const y = Math.round(top(bucketOf(ms)) + tall) + 0.5;
    ctx.strokeStyle = ink('grid');
    ctx.lineWidth = 1;
    ctx.beginPath();
    ctx.moveTo(LEFT, y);
    ctx.lineTo(width, y);
    ctx.stroke();
    ctx.fillStyle = ink('muted');
    ctx.textAlign = 'right';
    ctx.fillText(ms < 1000 ? `${ms}` : `${ms / 1000} s`, LEFT - 5, y + 4);
  }
  ctx.fillStyle = ink('accent');
  for (const { ago_s, shares } of columns) {
    shares.forEach((share, bucket) => {
      if (share === 0) return;
      ctx.globalAlpha = 0.15 + 0.85 * Math.sqrt(share);
      ctx.fillRect(width - (ago_s + 1) * wide, top(bucket), Math.ceil(wide), Math.ceil(tall));
    });
  }
  ctx.globalAlpha = 1;
  ctx.fillStyle = ink('muted');
  ctx.textAlign = 'left';
  ctx.fillText(`${SPAN_S} s ago`, LEFT, height - 3);
  ctx.textAlign = 'right';
  ctx.fillText('now', width, height - 3);
}
