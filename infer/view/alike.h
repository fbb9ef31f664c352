#pragma once

#include <cmath>
#include <cstddef>

#include "core/geometry/frame_errors.h"

namespace volalign {

// When two directions, two places or two depths are taken for one.

/// Cosine of the angle (45 deg) up to which a surface faces as a side does, rather than as one at
/// right angles to it.
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
/// Of a standard deviation, or of a tolerance: 997 of 1,000 normal variables lie within.
inline constexpr double kClearly = 3;
/// m: places that are nearer to each other are one. Boxes that are built up by hand stand a few
/// millimetres off, and none is as thin.
inline constexpr double kSamePlace = 0.02;
/// m: how far a surface of the structure is off at a pose that is not refined. Such poses are 13 mm
/// off in the median and up to 7 cm (docs/results.md, "Network, geometry or both").
inline constexpr double kRoughPose = 0.03;
/// m: the step in which sensors give depths.
inline constexpr double kDepthStep = 1e-3;
/// Standard deviation of an error of rounding to whole steps, or to whole pixels.
inline double StepSigma() { return 1 / std::sqrt(12); }
/// m: what is farther from a surface is no part of it.
inline constexpr double kFarthestOff = 0.1;
/// m: what is farther from a sensor is of no room that it is used in.
inline constexpr double kFarthest = 8;
/// Share of a side, or of the surroundings of its border, that has to be seen for it to count.
inline constexpr double kLeastShown = 0.2;
/// Share of a picture from which on something in it counts: less may be a reflection, or a small
/// thing that stands about.
inline constexpr double kNotable = 0.05;

/// Rounds at most in which something follows what it led to itself.
inline constexpr int kRounds = 3;
/// px along the border of the picture that sensors leave empty: a stereo matcher has no depth in a
/// band as wide as its largest disparity.
inline constexpr int kEmptyBorder = 12;
/// How many of thousands of points, or of trials, are looked at: where each costs much, and where
/// it costs little.
inline constexpr std::size_t kFewProbes = 80, kManyProbes = 400;
/// Of what is tried in a search: so many go on from one stage to the next.
inline constexpr std::size_t kBeam = 8;

}  // namespace volalign
