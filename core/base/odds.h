#pragma once

namespace volalign {

// The probabilities at which volalign decides, as odds.

/// Of a choice on which a person relies, or of a pose that is refuted: one in a hundred may be
/// wrong.
inline constexpr double kDecisiveOdds = 100;
/// Of another model of what was measured, be it a lens or the pose to beat: it is preferred from 20
/// to 1 on, the one error in twenty of statistics.
inline constexpr double kModelOdds = 20;
/// From which on another set of poses is not named: one in a million calibrations.
inline constexpr double kNamedOdds = 1e6;

}  // namespace volalign
