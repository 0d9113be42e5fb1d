// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <openvdb/openvdb.h>
#include <openvdb/tools/VolumeToMesh.h>
#include <tbb/global_control.h>
#include <glm/common.hpp>
#include <glm/vector_relational.hpp>

#include "trainer/mesh/tsdf_volume.h"
#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

using Coordinates = openvdb::Coord;
using Floats = openvdb::FloatGrid;
using Colors = openvdb::Vec3SGrid;

constexpr float kFarthestIndex = 1 << 24;
constexpr int kBlock = 8;  // voxels along a side of OpenVDB's leaves

/// Levels of the trees above the leaves. Scattered leaves share few of these nodes, which are larger than leaves.
template <class Tree>
using UpperNode = typename Tree::RootNodeType::ChildNodeType;
template <class Tree>
using LowerNode = typename UpperNode<Tree>::ChildNodeType;

/// Memory of one node, or leaf, in all three trees.
constexpr std::uint64_t kLeafBytes = std::uint64_t{kBlock} * kBlock * kBlock * (4 + 4 + 12);
constexpr std::uint64_t kLowerBytes = 2 * sizeof(LowerNode<Floats::TreeType>) + sizeof(LowerNode<Colors::TreeType>);
constexpr std::uint64_t kUpperBytes = 2 * sizeof(UpperNode<Floats::TreeType>) + sizeof(UpperNode<Colors::TreeType>);

}  // namespace

struct TsdfVolume::State {
  explicit State(const TsdfOptions& o) : options(o) {
    openvdb::initialize();
    distance = Floats::create(o.truncation);
    weight = Floats::create(0.0f);
    color = Colors::create(openvdb::Vec3f(0.0f));
  }

  /// Allocates the blocks within the truncation distance of the surface, along the ray of each pixel.
  void touch(const Camera& camera, std::span<const float> depth) {
    const glm::mat4 world_from_camera = glm::inverse(camera.camera_from_world);
    auto accessor = distance->getAccessor();
    Coordinates last(Coordinates::min());
    const float step = 0.5f * kBlock * options.voxel;
    for (int y = 0; y < camera.height; ++y) {
      for (int x = 0; x < camera.width; ++x) {
        const float d =
            depth[static_cast<std::size_t>(y) * static_cast<std::size_t>(camera.width) + static_cast<std::size_t>(x)];
        if (!(d > 0)) continue;
        const glm::vec3 ray((static_cast<float>(x) + 0.5f - camera.cx) / camera.fx,
                            (static_cast<float>(y) + 0.5f - camera.cy) / camera.fy, 1);
        const int steps = static_cast<int>(std::ceil(2 * options.truncation / step));
        for (int k = 0; k <= steps; ++k) {
          const float at = d - options.truncation +
                           2 * options.truncation * static_cast<float>(k) / static_cast<float>(std::max(steps, 1));
          if (!(at > 0)) continue;
          const glm::vec3 point(world_from_camera * glm::vec4(at * ray, 1));
          const glm::vec3 index = glm::floor(point / options.voxel);
          // Beyond this, single precision cannot distinguish neighbouring voxels.
          if (!(glm::all(glm::lessThan(glm::abs(index), glm::vec3(kFarthestIndex))))) continue;
          const Coordinates block(static_cast<int>(index.x) & ~(kBlock - 1), static_cast<int>(index.y) & ~(kBlock - 1),
                                  static_cast<int>(index.z) & ~(kBlock - 1));
          if (block == last) continue;
          last = block;
          if (accessor.probeConstLeaf(block) != nullptr) continue;
          bytes += kLeafBytes;
          if (accessor.probeNode<LowerNode<Floats::TreeType>>(block) == nullptr) bytes += kLowerBytes;
          if (accessor.probeNode<UpperNode<Floats::TreeType>>(block) == nullptr) bytes += kUpperBytes;
          require(bytes <= options.max_bytes,
                  "the mesh would take more than " + std::to_string(options.max_bytes >> 20) +
                      " MiB of memory: give a larger --voxel-size or a smaller --max-depth");
          accessor.touchLeaf(block);
          weight->tree().touchLeaf(block);
          color->tree().touchLeaf(block);
        }
      }
    }
  }

  TsdfOptions options;
  Floats::Ptr distance, weight;
  Colors::Ptr color;
  std::uint64_t bytes = 0;
};

bool has_tsdf_volumes() { return true; }

TsdfVolume::TsdfVolume(const TsdfOptions& options) : state_(std::make_unique<State>(options)) {
  require(options.voxel > 0 && options.truncation >= options.voxel,
          "the truncation distance must be at least the voxel size");
}
TsdfVolume::~TsdfVolume() = default;

std::uint64_t TsdfVolume::bytes() const { return state_->bytes; }

void TsdfVolume::integrate(const Camera& camera, std::span<const float> depth, std::span<const float> color,
                           const Threads& threads) {
  State& state = *state_;
  state.touch(camera, depth);
  // The three trees have the same leaves, in the same order.
  std::vector<Floats::TreeType::LeafNodeType*> distances, weights;
  std::vector<Colors::TreeType::LeafNodeType*> colors;
  state.distance->tree().getNodes(distances);
  state.weight->tree().getNodes(weights);
  state.color->tree().getNodes(colors);
  const float voxel = state.options.voxel, truncation = state.options.truncation;
  const auto width = static_cast<std::size_t>(camera.width);
  const std::size_t pixels = width * static_cast<std::size_t>(camera.height);
  threads.for_range(distances.size(), 64, [&](std::size_t begin, std::size_t end) {
    for (std::size_t leaf = begin; leaf < end; ++leaf) {
      const Coordinates origin = distances[leaf]->origin();
      // Skip blocks whose bounding sphere lies behind the camera.
      const float half = 0.5f * kBlock * voxel;
      const glm::vec3 corner(static_cast<float>(origin.x()) * voxel, static_cast<float>(origin.y()) * voxel,
                             static_cast<float>(origin.z()) * voxel);
      const glm::vec3 middle(camera.camera_from_world * glm::vec4(corner + half, 1));
      const float radius = 1.7321f * half;
      if (middle.z + radius <= 0) continue;
      for (openvdb::Index offset = 0; offset < kBlock * kBlock * kBlock; ++offset) {
        const Coordinates at = distances[leaf]->offsetToGlobalCoord(offset);
        const glm::vec3 point(camera.camera_from_world * glm::vec4(static_cast<float>(at.x()) * voxel,
                                                                   static_cast<float>(at.y()) * voxel,
                                                                   static_cast<float>(at.z()) * voxel, 1));
        if (!(point.z > 0)) continue;
        const float u = camera.fx * point.x / point.z + camera.cx, v = camera.fy * point.y / point.z + camera.cy;
        if (!(u >= 0 && v >= 0 && u < static_cast<float>(camera.width) && v < static_cast<float>(camera.height))) {
          continue;
        }
        const std::size_t p = static_cast<std::size_t>(v) * width + static_cast<std::size_t>(u);
        if (!(depth[p] > 0)) continue;
        const float ahead = depth[p] - point.z;
        if (ahead < -truncation) continue;  // hidden behind the surface
        const float before = weights[leaf]->getValue(offset), share = 1 / (before + 1);
        const float old = before > 0 ? distances[leaf]->getValue(offset) : 0.0f;
        distances[leaf]->setValueOn(offset, old + (std::min(ahead, truncation) - old) * share);
        const openvdb::Vec3f seen(color[p], color[pixels + p], color[2 * pixels + p]);
        const openvdb::Vec3f was = colors[leaf]->getValue(offset);
        colors[leaf]->setValueOn(offset, was + (seen - was) * share);
        weights[leaf]->setValueOn(offset, before + 1);
      }
    }
  });
}

TriangleMesh TsdfVolume::mesh(int least_views, const Threads& threads) const {
  const State& state = *state_;
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                  static_cast<std::size_t>(threads.count()));
  // Cells whose eight corners were each seen by at least `least_views` views.
  auto mask = openvdb::BoolGrid::create(false);
  {
    auto weights = state.weight->getConstAccessor();
    auto cells = mask->getAccessor();
    for (auto at = state.weight->cbeginValueOn(); at; ++at) {
      const Coordinates corner = at.getCoord();
      bool seen = true;
      for (int k = 0; k < 8 && seen; ++k) {
        seen = weights.getValue(corner.offsetBy(k & 1, k >> 1 & 1, k >> 2)) >= static_cast<float>(least_views);
      }
      if (seen) cells.setValueOn(corner, true);
    }
  }
  openvdb::tools::VolumeToMesh extract(0.0);
  extract.setSurfaceMask(mask);
  extract(*state.distance);

  TriangleMesh mesh;
  auto colors = state.color->getConstAccessor();
  auto weights = state.weight->getConstAccessor();
  for (std::size_t i = 0; i < extract.pointListSize(); ++i) {
    const openvdb::Vec3s point = extract.pointList()[i];
    const Coordinates corner = Coordinates::floor(openvdb::Vec3d(point));
    openvdb::Vec3f sum(0.0f);
    float of = 0;
    for (int k = 0; k < 8; ++k) {
      const Coordinates at = corner.offsetBy(k & 1, k >> 1 & 1, k >> 2);
      if (!(weights.getValue(at) > 0)) continue;
      float near = 1;
      for (int c = 0; c < 3; ++c) near *= 1 - std::min(1.0f, std::abs(point[c] - static_cast<float>(at[c])));
      sum += near * colors.getValue(at);
      of += near;
    }
    for (int c = 0; c < 3; ++c) {
      mesh.positions.push_back(point[c] * state.options.voxel);
      const float value = of > 0 ? sum[c] / of : 0.5f;
      mesh.colors.push_back(static_cast<std::uint8_t>(std::lround(255 * std::clamp(value, 0.0f, 1.0f))));
    }
  }
  const auto add = [&](openvdb::Index32 a, openvdb::Index32 b, openvdb::Index32 c) {
    mesh.triangles.insert(mesh.triangles.end(), {a, b, c});
  };
  for (std::size_t pool = 0; pool < extract.polygonPoolListSize(); ++pool) {
    const openvdb::tools::PolygonPool& polygons = extract.polygonPoolList()[pool];
    for (std::size_t i = 0; i < polygons.numQuads(); ++i) {
      const openvdb::Vec4I& quad = polygons.quad(i);
      add(quad[0], quad[1], quad[2]);
      add(quad[0], quad[2], quad[3]);
    }
    for (std::size_t i = 0; i < polygons.numTriangles(); ++i) {
      const openvdb::Vec3I& triangle = polygons.triangle(i);
      add(triangle[0], triangle[1], triangle[2]);
    }
  }
  return mesh;
}

}  // namespace splatboost
