#pragma once

#include <string_view>

namespace stillmap::mapping {

/// Style sheet of a report; colours of Okabe and Ito, which colour-blind readers tell apart.
inline constexpr std::string_view kReportStyle = R"(
:root { --ink: #1f2630; --soft: #67707d; --rule: #dfe3e8; --paper: #fff; --card: #f6f7f9; }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 1180px; padding: 28px 24px 60px; color: var(--ink); background: var(--paper);
  font: 14px/1.5 system-ui, "Liberation Sans", sans-serif; }
h1 { font-size: 24px; margin: 0 0 2px; } h2 { font-size: 17px; margin: 34px 0 2px; }
p { margin: 0 0 10px; color: var(--soft); max-width: 88ch; }
.facts { color: var(--soft); margin-bottom: 18px; }
.tiles { display: flex; flex-wrap: wrap; gap: 12px; margin: 14px 0; }
.tile { background: var(--card); border-radius: 8px; padding: 10px 16px; min-width: 150px; flex: 1; }
.tile b { display: block; font-size: 22px; font-weight: 600; } .tile span { color: var(--soft); font-size: 12.5px; }
.row { display: grid; grid-template-columns: repeat(3, 1fr); gap: 10px 18px; }
figure { margin: 0; } figcaption { color: var(--soft); font-size: 12.5px; padding-left: 52px; }
@media (max-width: 800px) { .row { grid-template-columns: 1fr; } }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; margin: 8px 0; width: 100%; }
th, td { text-align: right; padding: 5px 10px; border-bottom: 1px solid var(--rule); white-space: nowrap; }
th { font-weight: 600; font-size: 12.5px; color: var(--soft); } th:first-child, td:first-child { text-align: left; padding-left: 0; }
td small { color: var(--soft); }
.narrow { width: auto; min-width: 50%; }
.bad { color: #b3261e; font-weight: 600; } .good { color: #00704f; font-weight: 600; }
.key { display: inline-block; width: 11px; height: 11px; border-radius: 2px; margin-right: 7px; background: currentColor; vertical-align: -1px; }
.strip { display: flex; height: 12px; min-width: 120px; border-radius: 3px; overflow: hidden; }
.strip i { display: block; } .ok { background: #009e73; } .degraded { background: #e69f00; } .lost { background: #9aa3ae; }
pre { background: var(--card); border-radius: 8px; padding: 12px 14px; white-space: pre-wrap; overflow-wrap: anywhere; }
svg { width: 100%; height: auto; display: block; } svg text { font-size: 11px; fill: var(--ink); }
svg .tick { fill: var(--soft); } .middle { text-anchor: middle; } .end { text-anchor: end; }
svg .value { font-weight: 600; fill: #fff; } svg .note { fill: var(--soft); font-size: 10.5px; }
.grid { stroke: var(--rule); stroke-width: .7; } .frame { fill: none; stroke: #9aa3ae; }
.line { fill: none; stroke: currentColor; stroke-width: 1.8; stroke-linejoin: round; }
.whisker { stroke: var(--ink); stroke-width: 1.3; } .theory { stroke: #d55e00; } .diagonal { stroke: var(--ink); stroke-width: 1; }
.mark { stroke: var(--soft); stroke-width: 1; stroke-dasharray: 4 3; }
.fill { fill: currentColor; } .beyond { color: #b3261e; } .wrong { fill: #b3261e; }
.c0 { color: #0072b2; } .c1 { color: #d55e00; } .c2 { color: #009e73; } .c3 { color: #cc79a7; } .c4 { color: #b58900; } .c5 { color: #56b4e9; }
.nominal { fill: #e3f3ec; } .misleading { fill: #fdf0d5; } .hazardous { fill: #f8d9d6; } .unavailable { fill: #eceff3; }
)";

}  // namespace stillmap::mapping
