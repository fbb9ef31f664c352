#pragma once

namespace volalign {

// The probabilities at which volalign decides, as odds.

/// For a choice on which a person relies, or a pose that is refuted: one in a hundred may be wrong.
inline constexpr double kDecisiveOdds = 100;
/// For another model of the measurements, be it a lens or the pose to beat. It is preferred from 20
/// to 1 on: the usual error rate of statistics, one in twenty.
inline constexpr double kModelOdds = 20;
/// Against something unusual: one sensor, prior or sample in a thousand is otherwise.
inline constexpr double kUnusualOdds = 1000;
/// Above it, another set of poses is not reported: one in a million calibrations.
inline constexpr double kNamedOdds = 1e6;

}  // namespace volalign
