#pragma once

namespace stillmap::test {

/// Points of a package of schema 2 lie in the middle of its steps: at most so far beside where they
/// were given, on each axis [m].
inline constexpr double kOffByStepsM = 0.0003;

}  // namespace stillmap::test
