// SPDX-License-Identifier: Apache-2.0
#include "trainer/report/report_style.h"

namespace splatboost::report {

const char* const kStyle = R"css(
:root { color-scheme: light; --ink: #17202e; --soft: #5b6677; --line: #e3e7ee; --paper: #ffffff; --ground: #f5f7fa;
  --good: #0b7a45; --bad: #a8480f; --accent: #1668dc; }
* { box-sizing: border-box; }
body { margin: 0; background: var(--ground); color: var(--ink); font: 15px/1.5 system-ui, -apple-system, "Segoe UI", Roboto,
  "Noto Sans", "Helvetica Neue", "DejaVu Sans", sans-serif; font-variant-numeric: tabular-nums; -webkit-text-size-adjust: 100%; }
main { max-width: 1180px; margin: 0 auto; padding: 40px 24px 64px; }
header p { margin: 0; color: var(--soft); }
header .kind { color: var(--accent); font-weight: 600; font-size: 13px; letter-spacing: .04em; }
h1 { font-size: 30px; line-height: 1.2; margin: 4px 0 6px; letter-spacing: -.015em; overflow-wrap: anywhere; }
h2 { font-size: 20px; margin: 44px 0 12px; letter-spacing: -.01em; }
h3 { font-size: 14px; margin: 0; overflow-wrap: anywhere; }
small { color: var(--soft); font-weight: 400; font-size: 13px; }
.card { background: var(--paper); border: 1px solid var(--line); border-radius: 12px; }
.note { color: var(--soft); font-size: 13px; margin: 10px 2px; }
.tiles { display: grid; grid-template-columns: repeat(4, minmax(0, 1fr)); gap: 16px; margin-top: 28px; }
.tile { padding: 16px 20px; }
.tile h3 { color: var(--soft); font-weight: 500; }
.tile p { margin: 0; color: var(--soft); font-size: 13px; }
.tile .big { color: var(--ink); font-size: 27px; font-weight: 650; letter-spacing: -.02em; line-height: 1.35; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; }
th, td { padding: 9px 20px; text-align: right; white-space: nowrap; }
th { font-weight: 500; }
tbody th, .run td { text-align: left; }
thead th { color: var(--soft); font-size: 13px; }
tbody tr { border-top: 1px solid var(--line); }
table.results tbody tr:first-child td { font-weight: 650; }
.better { color: var(--good); font-weight: 600; }
.worse { color: var(--bad); font-weight: 600; }
.same { color: var(--soft); }
.run thead th { text-align: left; }
.run th { color: var(--soft); vertical-align: top; width: 1%; }
.run thead th { width: auto; }
.run td { white-space: normal; overflow-wrap: anywhere; }
code { font: 13px/1.5 ui-monospace, "SF Mono", Menlo, Consolas, "DejaVu Sans Mono", monospace; }
th i, .legend i, figcaption i { display: inline-block; width: 10px; height: 10px; border-radius: 3px; margin-right: 7px; }
.legend { margin: 0 2px 12px; display: flex; flex-wrap: wrap; gap: 4px 20px; font-size: 13px; }
.charts { display: grid; grid-template-columns: repeat(2, minmax(0, 1fr)); gap: 16px; }
figure { margin: 0; min-width: 0; }
.chart { padding: 16px 12px 8px; }
.chart figcaption { font-weight: 600; font-size: 14px; padding: 0 8px 6px; }
svg { display: block; width: 100%; height: auto; }
svg text { font-size: 12px; fill: var(--soft); }
svg .end { font-weight: 650; paint-order: stroke; stroke: #ffffff; stroke-width: 4px; stroke-linejoin: round; }
svg .grid { stroke: var(--line); }
svg .axis { stroke: #b4bcc8; }
svg .line { fill: none; stroke-width: 2.25; stroke-linejoin: round; stroke-linecap: round; }
svg .hit { fill-opacity: 0; }
svg .dot { opacity: 0; stroke: #ffffff; stroke-width: 1.5; }
svg .shown .dot, svg .point:hover .dot { opacity: 1; }
.bar { white-space: nowrap; }
.bar i { display: inline-block; width: 96px; height: 10px; border-radius: 5px; margin: 0 6px; }
.view { padding: 16px 20px 20px; margin-bottom: 16px; }
.view .grid { display: grid; grid-template-columns: repeat(var(--columns), minmax(0, 1fr)); gap: 14px; margin-top: 12px; }
.view figcaption { font-size: 13px; color: var(--soft); margin-top: 4px; }
.view img { display: block; width: 100%; height: auto; border-radius: 6px; background: #0c1018; }
.view label { display: block; cursor: zoom-in; }
.view input { position: absolute; opacity: 0; }
.view input:focus-visible + img { outline: 3px solid var(--accent); outline-offset: 2px; }
.view input:checked + img { position: fixed; inset: 0; z-index: 9; width: 100vw; height: 100vh; object-fit: contain;
  border-radius: 0; background: rgba(12, 16, 24, .96); cursor: zoom-out; }
.missing { display: grid; place-items: center; min-height: 120px; height: calc(100% - 26px); border-radius: 6px;
  background: var(--ground); color: var(--soft); font-size: 13px; }
.cell { display: flex; align-items: center; }
.view .head { display: flex; flex-wrap: wrap; justify-content: space-between; gap: 4px 24px; }
.view .legend { margin: 0; color: var(--soft); }
.view .legend b { color: var(--ink); font-weight: 600; margin-right: 4px; }
.facts { font-size: 13px; margin: 0 0 26px; }
.facts th, .facts td { padding: 6px 12px; }
.facts th:first-child { padding-left: 0; }
.stages { padding: 14px 20px; }
.stage { display: grid; grid-template-columns: 170px 1fr; align-items: center; padding: 7px 0; }
.stage + .stage { border-top: 1px solid var(--line); }
.stage p { margin: 0; display: flex; align-items: center; gap: 8px; padding-right: 92px; line-height: 1.45; }
.stage i { display: block; height: 10px; border-radius: 2px 5px 5px 2px; min-width: 2px; }
.stage b { font-weight: 500; font-size: 13px; white-space: nowrap; margin-right: -92px; }
details { margin-top: 16px; }
details summary { cursor: pointer; padding: 14px 20px; font-weight: 600; }
footer { margin-top: 44px; color: var(--soft); font-size: 13px; }
@media (max-width: 900px) { .charts { grid-template-columns: minmax(0, 1fr); }
  .tiles { grid-template-columns: repeat(2, minmax(0, 1fr)); } }
@media (max-width: 640px) {
  main { padding: 24px 14px 48px; }
  h1 { font-size: 24px; }
  .tiles { gap: 10px; }
  .tile { padding: 12px 14px; }
  .tile .big { font-size: 21px; }
  th, td { padding: 8px 10px; }
  table.results { font-size: 13px; }
  table.results th { white-space: normal; }
  svg text { font-size: 16px; }
  .view { padding: 14px; }
  .view .grid { grid-template-columns: repeat(2, minmax(0, 1fr)); gap: 10px; }
  .view .truth, .view .cell { grid-column: 1 / -1; }
  .view .cell { order: -1; }
  .facts { margin: 0; }
  .stage { grid-template-columns: minmax(0, 1fr); }
}
@media print { body { background: #ffffff; } .card { break-inside: avoid; } }
)css";

}  // namespace splatboost::report
