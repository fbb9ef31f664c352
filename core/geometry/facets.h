#pragma once

#include <vector>

#include "core/geometry/part_mesh.h"

namespace volalign {

/// Merges a closed surface's triangles into facets. `facet_of`: of each triangle.
void FindFacets(const std::vector<Eigen::Vector3d>& vertices,
                const std::vector<PartMesh::Triangle>& triangles, std::vector<Facet>* facets,
                std::vector<int>* facet_of);

}  // namespace volalign
