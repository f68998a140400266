import { useEffect, useRef } from 'preact/hooks';
import uPlot from 'uplot';
import 'uplot/dist/uPlot.min.css';
import { kKindColours } from '../scene/colour_maps.js';
import { extentOf, lengthOf, type Profile } from '../scene/section.js';
import { kKinds, type Theme } from '../scene/types.js';
import { number } from '../ui/format.js';
import { useStore } from '../state/store.js';
import { theme } from '../ui/theme.js';
import type { ViewerModel } from './model.js';

const kHeightPx = 230;

/** The section from the side. */
export function ProfilePanel({ model }: { model: ViewerModel }) {
  const section = useStore(model.tools.section);
  const profile = useStore(model.tools.profile);
  const now = useStore(theme);
  const { kinds } = useStore(model.options);
  const holder = useRef<HTMLDivElement>(null);
  useEffect(() => {
    const element = holder.current;
    if (element === null || section === undefined || profile === undefined) return undefined;
    const plot = new uPlot(settings(profile, kinds.map((kind) => kKinds.indexOf(kind)), now, element.clientWidth), [[0, lengthOf(section)], [null, null]], element);
    const observer = new ResizeObserver(() => plot.setSize({ width: element.clientWidth, height: kHeightPx }));
    observer.observe(element);
    return () => {
      observer.disconnect();
      plot.destroy();
    };
  }, [section, profile, now, kinds]);
  if (section === undefined || profile === undefined) return null;
  return (
    <section class="viewer-profile" aria-label="Section from the side">
      <header>
        <h2>Section</h2>
        <p class="quiet">{number(profile.heights.length)} points in full resolution. Drag to zoom, double-click to see all.</p>
        <button type="button" class="plain small" aria-label="Close the section" onClick={() => model.tools.clear()}>×</button>
      </header>
      <div ref={holder} class="viewer-plot" />
    </section>
  );
}

function settings(profile: Profile, kinds: readonly number[], now: Theme, width: number): uPlot.Options {
  const style = getComputedStyle(document.documentElement);
  const colour = (name: string): string => style.getPropertyValue(name).trim();
  const axis: uPlot.Axis = { stroke: colour('--quiet'), grid: { stroke: colour('--line') }, ticks: { stroke: colour('--line') } };
  const [low, high] = shownHeights(profile);
  return {
    width, height: kHeightPx, legend: { show: false },
    cursor: { drag: { x: true, y: true, uni: 20 } },
    scales: { x: { time: false, range: (_, min, max) => [min, max] }, y: { range: (_, min, max) => (min === null || max === null || !Number.isFinite(min) ? [low, high] : [min, max]) } },
    axes: [{ ...axis, label: 'along the section [m]', labelSize: 20, size: 34 }, { ...axis, label: 'height [m]', labelSize: 20, size: 48 }],
    series: [{}, { show: true }],
    hooks: {
      draw: [(plot) => drawPoints(plot, profile, kinds, now)],
      setSelect: [(plot) => {
        const { top, height } = plot.select;
        if (height > 0) plot.setScale('y', { min: plot.posToVal(top + height, 'y'), max: plot.posToVal(top, 'y') });
      }],
      ready: [(plot) => plot.over.addEventListener('dblclick', () => plot.setScale('y', { min: low, max: high }))],
    },
  };
}

function drawPoints(plot: uPlot, { along, heights, kinds }: Profile, shown: readonly number[], now: Theme): void {
  const { ctx, bbox } = plot;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  const size = 1.6 * devicePixelRatio;
  // One colour after the other: most of the time would go into changing it for each point.
  for (const kind of shown) {
    ctx.fillStyle = `rgb(${kKindColours[now][kKinds[kind] as (typeof kKinds)[number]].join(' ')})`;
    for (let i = 0; i < along.length; ++i) {
      if (kinds[i] !== kind) continue;
      const x = plot.valToPos(along[i] as number, 'x', true);
      const y = plot.valToPos(heights[i] as number, 'y', true);
      ctx.fillRect(x - size / 2, y - size / 2, size, size);
    }
  }
  ctx.restore();
}

// With a margin, also for a section without points.
function shownHeights(profile: Profile): [number, number] {
  const [low, high] = extentOf(profile) ?? [0, 1];
  const room = Math.max(0.04 * (high - low), 0.2);
  return [low - room, high + room];
}
