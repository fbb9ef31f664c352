#pragma once

#include <cmath>
#include <cstddef>

#include "core/geometry/frame_errors.h"

namespace volalign {

// Tolerances within which two directions, places or depths count as one.

/// Cosine of the largest angle (45 deg) at which a surface faces as a side does. Beyond it, a side
/// at right angles is nearer.
inline constexpr double kFacesAlike = M_SQRT1_2;
/// Cosine of the angle (25 deg) between normals of one plane, each from a few noisy depths.
inline constexpr double kOnePlane = 0.9;
/// Cosine of the angle (8 deg) between normals of a structure's sides that face the same way.
inline constexpr double kSameNormal = 0.99;
/// Cosine of the angle (15 deg) between directions of planes that face the same way.
inline constexpr double kSameDirection = 0.966;
/// px to each side of a pixel over which its surface's normal is taken.
inline constexpr int kNormalRadius = 3;
/// Side, px, of the square image blocks whose points on one surface are one measurement.
inline constexpr int kBlock = 16;
/// Factor on a standard deviation, or on a tolerance: 997 of 1,000 normal variables lie within.
inline constexpr double kClearly = 3;
/// m: places that are nearer to each other are one. Boxes that are stacked by hand are a few
/// millimetres out of place, and none is as thin.
inline constexpr double kSamePlace = 0.02;
/// m: error of the structure's surfaces at a pose that is not refined. Such poses are 13 mm off in
/// the median and up to 7 cm (docs/results.md, "Network, geometry or both").
inline constexpr double kRoughPose = 0.03;
/// m: the step in which sensors give depths.
inline constexpr double kDepthStep = 1e-3;
/// Standard deviation of rounding to whole steps, or to whole pixels.
inline double StepSigma() { return 1 / std::sqrt(12); }
/// m: a point farther from a surface is no part of it.
inline constexpr double kFarthestOff = 0.1;
/// m: a point farther from a sensor is outside of any room that it is used in.
inline constexpr double kFarthest = 8;
/// Least visible share of a side, or of the surroundings of its border, for it to count.
inline constexpr double kLeastShown = 0.2;
/// Least share of a picture for something in it to count. Less may be a reflection, or a small
/// object.
inline constexpr double kNotable = 0.05;

/// Most rounds of an iteration whose results change its input.
inline constexpr int kRounds = 3;
/// px along the border of the picture that sensors leave empty. A stereo matcher has no depth in a
/// band as wide as its largest disparity.
inline constexpr int kEmptyBorder = 12;
/// How many of thousands of points, or of trials, are examined: where each is expensive, and where
/// it is cheap.
inline constexpr std::size_t kFewProbes = 80, kManyProbes = 400;
/// Number of candidates in a search that go on from one stage to the next.
inline constexpr std::size_t kBeam = 8;

}  // namespace volalign
