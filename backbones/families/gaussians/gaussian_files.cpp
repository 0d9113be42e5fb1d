// SPDX-License-Identifier: Apache-2.0
#include "families/gaussians/gaussian_trainer.h"

#include <algorithm>
#include <utility>

#include "trainer/dataset/splat_ply.h"
#include "trainer/support/atomic_file.h"
#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

constexpr const char* kGroupsFile = "parameters.bin";  ///< model file with the method's groups

/// Truncates all arrays to the shortest: if memory ran out while Gaussians were added, their lengths differ.
void keep_whole_rows(SplatCloud& cloud) {
  const std::size_t rest = 3 * static_cast<std::size_t>(cloud.sh_rest_rows);
  const std::size_t n =
      std::min({cloud.means.size() / 3, cloud.sh_dc.size() / 3, cloud.sh_rest.size() / rest,
                cloud.logit_opacities.size(), cloud.log_scales.size() / 3, cloud.rotations.size() / 4});
  cloud.means.resize(3 * n);
  cloud.sh_dc.resize(3 * n);
  cloud.sh_rest.resize(rest * n);
  cloud.logit_opacities.resize(n);
  cloud.log_scales.resize(3 * n);
  cloud.rotations.resize(4 * n);
}

}  // namespace

void GaussianTrainer::export_moment(float time, const std::filesystem::path& file) {
  if (!uses_time()) return Backbone::export_moment(time, file);
  const Gaussians moment = drawn({context_.scene.train.front().camera, time, iteration_, DrawPurpose::evaluate});
  SplatCloud cloud;
  cloud.means = copy_to_host(moment.means, device_);
  cloud.sh_dc = f_dc_.values.to_host();
  cloud.sh_rest = f_rest_.values.to_host();
  cloud.sh_rest_rows = kRestRows;
  for (const float opacity : copy_to_host(moment.opacities, device_)) {
    // Opacities of 0 and 1 have no logit.
    cloud.logit_opacities.push_back(logit(std::clamp(static_cast<double>(opacity), 1e-6, 1 - 1e-6)));
  }
  for (const float scale : copy_to_host(moment.scales, device_)) {
    // The sign of a scale has no effect, and the file stores its logarithm.
    cloud.log_scales.push_back(std::log(std::max(std::abs(scale), 1e-10f)));
  }
  cloud.rotations = copy_to_host(moment.rotations, device_);
  write_splat_ply(file, cloud);
}

std::uint64_t GaussianTrainer::export_model(const std::filesystem::path& folder) const {
  SplatCloud cloud;
  cloud.means = xyz_.values.to_host();
  cloud.sh_dc = f_dc_.values.to_host();
  cloud.sh_rest = f_rest_.values.to_host();
  cloud.sh_rest_rows = kRestRows;
  cloud.logit_opacities = opacity_.values.to_host();
  cloud.log_scales = scaling_.values.to_host();
  cloud.rotations = rotation_.values.to_host();
  keep_whole_rows(cloud);
  // If memory ran out before the method followed a change of the Gaussians, its data belong to other Gaussians.
  if (!set_changed_) method_->export_to(cloud);
  const std::filesystem::path path = folder / "point_cloud.ply";
  write_splat_ply(path, cloud);
  const std::vector<TrainedGroup*> kept = model_groups();
  if (kept.empty()) return std::filesystem::file_size(path);
  ArchiveWriter archive;
  std::vector<float> copy;
  for (const TrainedGroup* group : kept) archive.put(group->name, group->values.on_host(copy));
  write_second_file(path, [&] { archive.write(folder / kGroupsFile); });
  return std::filesystem::file_size(path) + std::filesystem::file_size(folder / kGroupsFile);
}

void GaussianTrainer::import_model(const std::filesystem::path& folder) {
  SplatCloud cloud = read_splat_ply(folder / "point_cloud.ply");
  const std::size_t n = cloud.size();
  if (const std::vector<TrainedGroup*> kept = model_groups(); !kept.empty()) {
    require_second_file(folder / kGroupsFile);
    const ArchiveReader archive(folder / kGroupsFile);
    for (TrainedGroup* group : kept) {
      std::vector<float> values = archive.floats(group->name);
      require(values.size() == (group->shape == GroupShape::rows ? n * group->width : group->values.size()),
              archive.path().string() + ": '" + group->name + "' does not match point_cloud.ply or this backbone");
      group->assign(std::move(values));
    }
  }
  for (TrainedGroup* group : row_groups_) {
    if (!group->in_model) group->assign(std::vector<float>(n * group->width, 0.0f));
  }
  set_changed_ = !method_->import_from(cloud);
  require(!set_changed_ || cloud.filters.empty(),
          (folder / "point_cloud.ply").string() +
              ": has filter_3D of Mip-Splatting, without which it is another model; restore config.json of its run");
  std::vector<float> rest(n * 3 * kRestRows, 0.0f);
  const auto rows = static_cast<std::size_t>(cloud.sh_rest_rows);
  for (std::size_t i = 0; i < n; ++i) {
    std::copy_n(cloud.sh_rest.begin() + static_cast<std::ptrdiff_t>(3 * rows * i), 3 * rows,
                rest.begin() + static_cast<std::ptrdiff_t>(3 * kRestRows * i));
  }
  xyz_.assign(std::move(cloud.means));
  f_dc_.assign(std::move(cloud.sh_dc));
  f_rest_.assign(std::move(rest));
  opacity_.assign(std::move(cloud.logit_opacities));
  scaling_.assign(std::move(cloud.log_scales));
  rotation_.assign(std::move(cloud.rotations));
  restart_statistics();
  iteration_ = context_.iterations;  // a finished model: all SH degrees are active
  stale_ = true;
  activate();
}

void GaussianTrainer::save(ArchiveWriter& archive) const {
  archive.put(entry("iteration"), std::int64_t{iteration_});
  archive.put(entry("config"), std::string_view(method_->config().dump()));
  for (const TrainedGroup* group : groups_) group->save(archive);
  std::vector<float> copy;
  archive.put(entry("gradient_sum"), gradient_sum_.on_host(copy));
  archive.put(entry("gradient_abs_sum"), gradient_abs_sum_.on_host(copy));
  archive.put(entry("seen"), seen_.on_host(copy));
  method_->save(archive);
}

void GaussianTrainer::load(ArchiveReader& archive) {
  if (archive.text(entry("config")) != method_->config().dump()) {
    throw InputError(archive.path().string() +
                     ": the checkpoint was made with a different backbone config; continue with the same --config");
  }
  std::vector<std::size_t> dense_sizes;
  for (TrainedGroup* group : groups_) {
    if (group->shape == GroupShape::dense) dense_sizes.push_back(group->values.size());
    group->load(archive);
  }
  iteration_ = static_cast<int>(archive.integer(entry("iteration")));
  gradient_sum_.assign(archive.floats(entry("gradient_sum")));
  gradient_abs_sum_.assign(archive.floats(entry("gradient_abs_sum")));
  seen_.assign(archive.floats(entry("seen")));
  const std::size_t n = primitives();
  bool fits = gradient_sum_.size() == n && gradient_abs_sum_.size() == n && seen_.size() == n;
  for (const TrainedGroup* group : row_groups_) fits = fits && group->rows() == n;
  auto dense_size = dense_sizes.begin();
  for (const TrainedGroup* group : groups_) {
    if (group->shape == GroupShape::dense) fits = fits && group->values.size() == *dense_size++;
  }
  if (!fits) throw InputError(archive.path().string() + ": tensor sizes do not match; the checkpoint is damaged");
  method_->load(archive, n);
  stale_ = true;
  set_changed_ = false;
}

}  // namespace splatboost
