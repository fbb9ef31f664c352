#pragma once

#include "render/depth_renderer.h"
#include "render/tiles/tile_kernels.h"

namespace volalign {

/// Draws on the processor, without a driver and without a lock: one renderer per thread may run.
///
/// The picture is divided into tiles of 16x8 pixels. In homogeneous coordinates, two functions of a
/// pixel's ray are linear: whether it passes through a face, and 1 / depth where it does. Source:
/// Olano and Greer, "Triangle scan conversion using 2D homogeneous coordinates", 1997. So no face
/// is clipped or projected. A lens is as exact as a pinhole, as each pixel has its own ray. The
/// functions' extremes over the rectangle of a tile's rays give the faces that the tile may see and
/// the edges that cut it. A tile draws its faces from the nearest on and skips those behind its
/// cover.
///
/// Depth is where the ray meets the face's plane, exact to float rounding. The picture is the same
/// to the last bit for all instruction sets and threads. Tests name other kernels than those
/// of the processor's best instructions.
RendererFactory TileRenderers(const tiles::TileKernels& kernels = tiles::AllKernels().Best());

}  // namespace volalign
