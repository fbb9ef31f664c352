#pragma once

#include "core/config/config.h"

namespace volalign {

/// Depth errors of a kind of sensor. All parts are independent, and standard deviations except for
/// the lengths. z is the depth along the optical axis, m.
struct DepthErrorModel {
  double white_m = 0;  ///< of each pixel, at 2 m
  double white_power = 0;
  double smooth_m = 0;  ///< of the error that neighbours share, at 2 m
  double smooth_power = 0;
  double smooth_rad = 0;  ///< its correlation falls to about 1/e within this angle
  double offset_m = 0;    ///< of a whole frame
  double gain = 0;        ///< of a whole frame, as a share of the depth
  /// By this share, a device's depths are too long or too short beyond that. Sigma leaves it out,
  /// as a pose that was fitted to the boxes contains it.
  double unit_gain = 0;
  /// Tilt of a whole frame, per rad from its middle along each axis of the picture, at 2 m. Grows
  /// as white_m does.
  double tilt_m = 0;
  double shear_m = 0;  ///< the same, times the shear of a surface's picture (FrameErrorsAt)
  /// Mean error from light that comes by the floor or by another box (DiffuseMultipathShare). The
  /// error is distributed evenly from 0 to twice the mean.
  double bounce_m = 0;
  double bounce_reach_m = 0;  ///< distance from the floor at which bounce_m is largest
  double seam_m = 0;          ///< in a concave corner, from where it falls linearly
  double seam_reach_m = 0;
  double lateral_rad = 0;   ///< across the ray
  double edge_gap_rad = 0;  ///< without depth on the far side of a depth edge
  /// Width of a stereo matcher's window for one depth; 0 if each pixel has its own.
  double window_rad = 0;

  double White(double z) const;
  double Smooth(double z) const;
  double SmoothGrowth(double z) const;  ///< of smooth_m, from 2 m
  double TiltGrowth(double z) const;    ///< of tilt_m and shear_m, from 2 m
  /// Error of a pixel against others of its surface in the same frame, m. Corners count by their
  /// mean over their reach.
  double WithinSurface(double z) const;
  /// Error of a pixel, all parts, m.
  double Sigma(double z) const;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("white_m", white_m, "standard deviation, m, of each pixel's own error at 2 m", AtLeast(0));
    ar("white_power", white_power, "it grows with this power of the depth", Between(0, 3));
    ar("smooth_m", smooth_m, "standard deviation, m, of the error that neighbours share, at 2 m",
       AtLeast(0));
    ar("smooth_power", smooth_power, "it grows with this power of the depth", Between(0, 3));
    ar("smooth_rad", smooth_rad, "its correlation length, rad", Above(0));
    ar("offset_m", offset_m, "standard deviation, m, of a constant error of a frame", AtLeast(0));
    ar("gain", gain, "standard deviation of a frame's error as a share of the depth", AtLeast(0));
    ar("unit_gain", unit_gain, "standard deviation of the scale of one device's depths",
       AtLeast(0));
    ar("tilt_m", tilt_m,
       "standard deviation, m per rad at 2 m, of an error that grows from the middle of a frame",
       AtLeast(0));
    ar("shear_m", shear_m,
       "standard deviation, m at 2 m, of what rows of a stereo pair that do not meet add to the "
       "depth of a surface, times the shear of its picture",
       AtLeast(0));
    ar("bounce_m", bounce_m,
       "m, of what light that bounced off the floor or another box adds to the depth of a side in "
       "the mean, where it is most; evenly from nothing to twice that",
       AtLeast(0));
    ar("bounce_reach_m", bounce_reach_m, "m, from the corner to where that is", Above(0));
    ar("seam_m", seam_m, "standard deviation, m, in a concave corner", AtLeast(0));
    ar("seam_reach_m", seam_reach_m, "m, from the corner to where that has fallen to 0", Above(0));
    ar("lateral_rad", lateral_rad, "standard deviation, rad, across the ray", AtLeast(0));
    ar("edge_gap_rad", edge_gap_rad, "rad without depth on the far side of a depth edge",
       AtLeast(0));
    ar("window_rad", window_rad,
       "width, rad, of the window over which a stereo matcher takes one depth", AtLeast(0));
  }
};

}  // namespace volalign
