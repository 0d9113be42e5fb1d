// SPDX-License-Identifier: Apache-2.0
#include "families/anchors/anchor_backbone.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "families/nets/smooth_functions.h"
#include "splatboost/activations.h"
#include "splatboost/neighbors.h"
#include "splatboost/random.h"
#include "splatboost/rows.h"
#include "splatboost/schedule.h"
#include "splatboost/select.h"
#include "trainer/backbone_api/raster_laps.h"
#include "trainer/dataset/scene_depths.h"
#include "trainer/dataset/splat_ply.h"
#include "trainer/support/atomic_file.h"
#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

constexpr std::size_t kGrain = 4096;
constexpr float kLogitTenth = -2.1972246f;  // opacity of an anchor in files; not read by anything
constexpr const char* kNetsFile = "nets.bin";
constexpr float kMinSquaredDistance = 1e-7f;  // between neighbours at initialisation; keeps log scales finite

}  // namespace

AnchorBackbone::AnchorBackbone(const BackboneContext& context, const AnchorConfig& config, const DecoderShape& shape,
                               int published_iterations)
    : context_(context),
      config_(config),
      shape_(shape),
      published_iterations_(published_iterations),
      unit_(config.absolute_distances ? 1.0 : typical_depth(context.scene) / kAnchorDepth),
      device_(context.device),
      rasterizer_(device_),
      photometric_(device_),
      view_(shape, device_),
      statistics_(shape.offsets, device_),
      offsets_("offset", 3 * shape.offsets, device_,
               [this, rate = falling(config.offset_rate_initial, config.offset_rate_final)](int iteration) {
                 const double extent = config_.absolute_distances ? context_.scene.extent : kAnchorExtent;
                 return static_cast<double>(static_cast<float>(extent) * static_cast<float>(rate(iteration)));
               }),
      features_("anchor_feat", shape.features, device_, [this](int) { return config_.feature_rate; }),
      scaling_("scaling", 6, device_, [this](int) { return config_.scaling_rate; }),
      opacity_net_("mlp_opacity", 1, device_, falling(config.opacity_net_rate_initial, config.opacity_net_rate_final)),
      cov_net_("mlp_cov", 1, device_, falling(config.cov_net_rate_initial, config.cov_net_rate_final)),
      color_net_("mlp_color", 1, device_, falling(config.color_net_rate_initial, config.color_net_rate_final)),
      bank_net_("mlp_featurebank", 1, device_, falling(config.feat_bank_rate_initial, config.feat_bank_rate_final)),
      embedding_("embedding_appearance", std::max<std::size_t>(shape.appearance, 1), device_,
                 falling(config.appearance_rate_initial, config.appearance_rate_final)),
      groups_{&offsets_, &features_, &scaling_, &opacity_net_, &cov_net_, &color_net_} {
  if (shape.feature_bank) groups_.push_back(&bank_net_);
  if (shape.appearance > 0) groups_.push_back(&embedding_);
  const RandomStream random(context.seed, 0, RandomPurpose::net_parameters);
  std::uint64_t next = 0;
  const auto start = [&](TrainedGroup& group, const NetShape& net) {
    group.assign(initial_net_parameters(net, random, next));
    next += net.parameters();
  };
  start(opacity_net_, shape.opacity());
  start(cov_net_, shape.covariance());
  start(color_net_, shape.color());
  if (shape.feature_bank) start(bank_net_, shape.bank());
  if (shape.appearance > 0) {
    std::vector<float> rows(context.scene.train.size() * shape.appearance);
    for (std::size_t i = 0; i < rows.size(); ++i) rows[i] = static_cast<float>(random.normal(next + i));
    embedding_.assign(std::move(rows));
  }
}

int AnchorBackbone::at(int published) const {
  return scaled_iteration(published, context_.iterations, published_iterations_);
}

void AnchorBackbone::set_anchors(std::span<const float> positions) {
  const std::size_t given = positions.size() / 3;
  require(given > 0, "the scene has no points to place anchors at; add a point cloud to the dataset");
  std::vector<float> squared(given);
  mean_squared_neighbor_distances(positions, 3, squared, context_.threads);
  const std::size_t n = context_.max_primitives > 0 ? std::min(given, context_.max_primitives) : given;
  std::vector<float> scaling;
  std::vector<std::uint8_t> dropped(given, 1);
  positions_.clear();
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t from = i * given / n;
    dropped[from] = 0;
    positions_.insert(positions_.end(), &positions[3 * from], &positions[3 * from] + 3);
    scaling.insert(scaling.end(), 6, 0.5f * std::log(std::max(squared[from], kMinSquaredDistance)));
  }
  for (const SideRow& row : side_rows_) remove_rows(*row.values, 1, dropped);
  offsets_.assign(std::vector<float>(n * offsets_.width, 0.0f));
  features_.assign(std::vector<float>(n * features_.width, 0.0f));
  scaling_.assign(std::move(scaling));
  statistics_.reset(n);
  stale_ = anchors_changed_ = true;
}

void AnchorBackbone::activate() {
  if (anchors_changed_) {
    if (device_.is_cuda()) device_positions_.assign(positions_);
    anchors_changed();
    anchors_changed_ = false;
  }
  if (!stale_) return;
  scales_.ensure(scaling_.values.size());
  if (device_.is_cuda()) {
    exponentials(scaling_.values, scales_, device_);
  } else {  // smooth_exp, as in the nets' kernels: the same result with every instruction set
    const std::vector<float>& logarithms = scaling_.values.host();
    std::vector<float>& scales = scales_.host();
    context_.threads.for_range(scales.size(), kGrain, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) scales[i] = smooth_exp(logarithms[i]);
    });
  }
  stale_ = false;
}

std::span<const float> AnchorBackbone::positions_on_device() const {
  return device_.is_cuda() ? device_positions_.span() : std::span<const float>(positions_);
}

DecoderInputs<float> AnchorBackbone::decoder_inputs() const {
  return {positions_on_device(), offsets_.values, features_.values,  scales_,          levels(),
          opacity_net_.values,   cov_net_.values, color_net_.values, bank_net_.values, view_embedding_};
}

void AnchorBackbone::use_embedding_of(const View* view) {
  const std::size_t width = shape_.appearance;
  if (width == 0) return;
  if (const std::optional<std::size_t> row = view == nullptr ? std::nullopt : training_index(context_.scene, *view)) {
    view_embedding_ = embedding_.values.span().subspan(width * *row, width);
    return;
  }
  // A view that is not a training view has no embedding; the mean of all is the neutral one.
  if (mean_embedding_.empty()) {
    std::vector<float> copy, mean(width, 0.0f);
    const std::span<const float> rows = embedding_.values.on_host(copy);
    for (std::size_t i = 0; i < rows.size(); ++i) mean[i % width] += rows[i];
    for (float& value : mean) value /= static_cast<float>(std::max<std::size_t>(embedding_.rows(), 1));
    mean_embedding_.assign(std::move(mean));
  }
  view_embedding_ = mean_embedding_;
}

void AnchorBackbone::decode(const Camera& camera, bool ahead) {
  activate();
  const std::span<const std::uint8_t> usable = usable_anchors(camera);  // first, because it may call forget_views()
  decoded_ = &view_.decode(camera, decoder_inputs(), usable, ahead);
}

Gaussians AnchorBackbone::gaussians() const {
  Gaussians g;
  g.count = decoded_->count;
  g.means = decoded_->means;
  g.scales = decoded_->scales;
  g.rotations = decoded_->rotations;
  g.opacities = decoded_->opacities;
  g.colors = decoded_->colors;
  return g;
}

void AnchorBackbone::draw(const Camera& camera, std::optional<float> beta, const RasterImages& images) {
  RasterOptions options;
  if (beta) {
    options.box = BoxPolicy::ellipse;
    options.beta = *beta;
  }
  options.background = glm::vec3(context_.scene.white_background ? 1.0f : 0.0f);
  rasterizer_.forward(camera, gaussians(), options, images);
}

void AnchorBackbone::draw(const Camera& camera, std::optional<float> beta, std::span<float> color) {
  RasterImages images;
  images.color = color;
  draw(camera, beta, images);
}

std::size_t AnchorBackbone::bytes_per_primitive() const {
  const std::size_t slots = shape_.offsets, outputs = 11 * slots;
  const std::size_t trained = 4 * (3 * slots + shape_.features + 6) * sizeof(float);  // values, gradients, two moments
  const std::size_t gathered = slots * (2 * sizeof(float) + 32);                      // statistics and scores
  const std::size_t decoded = (3 * shape_.features + outputs) * sizeof(float);
  // In photos of rooms and streets the view that saw most drew a quarter of all slots.
  return trained + gathered + decoded + slots * (drawn_memory_bytes() + 30 * sizeof(float)) / 4;
}

double AnchorBackbone::train_step(int iteration, const View& view) {
  clock_.restart();
  iteration_ = iteration;
  image_.ensure(view.color.size());
  image_gradient_.ensure(view.color.size());
  use_embedding_of(&view);
  decode(view.camera, true);
  clock_.lap("decode");
  draw(view.camera, beta_, image_);
  lap_forward(rasterizer_, device_, clock_);

  const auto lambda = static_cast<float>(config_.lambda_dssim);
  const TruthImage truth = truths_.of(view);
  // In the last iteration wait for the loss, so that the run reports the final one.
  const bool last = iteration == context_.iterations;
  const PhotometricLoss loss = last ? photometric_.evaluate(image_, truth, lambda, image_gradient_)
                                    : photometric_.evaluate_ahead(image_, truth, lambda, image_gradient_);
  clock_.lap("loss");

  const bool gathering = iteration > at(config_.statistics_from) && iteration < at(config_.grow_until);
  const std::size_t m = decoded_->count;
  gaussian_gradients_.means.ensure(3 * m);
  gaussian_gradients_.scales.ensure(3 * m);
  gaussian_gradients_.rotations.ensure(4 * m);
  gaussian_gradients_.opacities.ensure(m);
  gaussian_gradients_.colors.ensure(3 * m);
  GaussianGradients gradients;
  gradients.means = gaussian_gradients_.means;
  gradients.scales = gaussian_gradients_.scales;
  gradients.rotations = gaussian_gradients_.rotations;
  gradients.opacities = gaussian_gradients_.opacities;
  gradients.colors = gaussian_gradients_.colors;
  if (gathering) {
    screen_.ensure(2 * m);
    gradients.screen_means = screen_;
  }
  RasterImageGradients image_gradients;
  image_gradients.color = image_gradient_;
  rasterizer_.backward(gaussians(), image_gradients, gradients);
  lap_backward(rasterizer_, device_, clock_);

  const double volume =
      view_.add_volume_loss(config_.volume_weight / (unit_ * unit_ * unit_), gaussian_gradients_.scales, !last);
  std::span<float> embedding_gradient;
  if (const std::optional<std::size_t> row = training_index(context_.scene, view); row && shape_.appearance > 0) {
    embedding_gradient = embedding_.gradients.span().subspan(*row * shape_.appearance, shape_.appearance);
  }
  view_.backward(decoder_inputs(),
                 {gaussian_gradients_.means, gaussian_gradients_.scales, gaussian_gradients_.rotations,
                  gaussian_gradients_.opacities, gaussian_gradients_.colors},
                 {offsets_.gradients, features_.gradients, scaling_.gradients, opacity_net_.gradients,
                  cov_net_.gradients, color_net_.gradients, bank_net_.gradients, embedding_gradient});
  for (TrainedGroup* group : groups_) group->pending = true;
  clock_.lap("decode_backward");

  if (gathering) {
    statistics_.add_anchors(decoded_->anchors, decoded_->all_opacities);
    statistics_.add_gaussians(decoded_->slots, rasterizer_.visible(), screen_, view.camera.width, view.camera.height);
  }
  clock_.lap("statistics");
  if (step_due_groups(groups_, optimizer_, moment(), device_)) parameters_moved();
  average_if_due(groups_, optimizer_, moment(), device_);
  clock_.lap("optimizer");
  const bool own = gathering && iteration > at(config_.grow_from) && iteration % config_.grow_interval == 0;
  if (density_ != nullptr ? density_->grows_at(moment(), own) : own) change_anchors();
  clock_.lap("density");
  return loss.total + volume;
}

std::function<double(int)> AnchorBackbone::falling(double initial, double final_value) const {
  return [initial, final_value, total = context_.iterations](int iteration) {
    return exponential_rate(initial, final_value, iteration, total);
  };
}

void AnchorBackbone::step_all() {
  if (step_groups(groups_, optimizer_, moment(), device_)) parameters_moved();
}

void AnchorBackbone::parameters_moved() {
  mean_embedding_.ensure(0);
  stale_ = true;
}

void AnchorBackbone::change_anchors() {
  step_all();
  forget_averages(groups_);
  activate();
  if (device_.is_cuda()) {
    on_host_ = {offsets_.values.to_host(), features_.values.to_host(), scales_.to_host()};
  }
  const double anchor_views = config_.grow_interval * config_.success_threshold;
  statistics_.mean_gradients(mean_gradients_);
  statistics_.slots_seen_over(0.5 * anchor_views, judged_);
  growing_.assign(judged_.size(), 0);
  choose_growing(mean_gradients_, judged_, growing_);
  anchors_changed_ = true;  // choose_growing() may change side rows
  if (density_ != nullptr) {
    const DensityStatistics known{moment(), context_.scene.extent, mean_gradients_, {}, {}, {}};
    GrowDecisions decisions{growing_, {}};
    density_->grow(known, slots_hook_, decisions);
  }
  grow(mean_gradients_, growing_);

  // Reset the slots that were judged, not those that grew: a density hook must not change this.
  statistics_.restart_slots(judged_);
  statistics_.faint_anchors(anchor_views, config_.min_opacity, removed_);
  statistics_.restart_anchors_seen_over(anchor_views);
  const std::vector<float> equal(removed_.size(), 0.0f);
  if (spare_one(equal, removed_) > 0) remove_anchors(removed_);
  const auto largest = static_cast<float>(config_.max_log_size + std::log(unit_));
  scaling_.values.edit(0, [&](std::span<float> logarithms) {
    for (std::size_t i = 0; i < primitives(); ++i) {
      for (std::size_t c = 3; c < 6; ++c) {
        float& value = logarithms[6 * i + c];
        value = std::min(value, largest);
      }
    }
  });
  on_host_ = {};
  stale_ = anchors_changed_ = true;
}

std::size_t AnchorBackbone::append_anchors(std::span<const float> positions, float log_size,
                                           std::span<const float> features, std::span<const float> importance) {
  std::vector<std::uint8_t> kept(importance.size(), 1);
  if (context_.max_primitives > 0) {
    keep_largest(importance, context_.max_primitives - std::min(context_.max_primitives, primitives()), kept);
  }
  const auto added = static_cast<std::size_t>(std::count(kept.begin(), kept.end(), std::uint8_t{1}));
  if (added == 0) return 0;
  const std::size_t first = primitives();
  // Reserve all groups first: if memory runs out, the model stays intact.
  for (TrainedGroup* group : anchor_groups()) group->reserve_rows(first + added);
  statistics_.reserve(first + added);
  const Array<std::uint32_t> any(device_, std::vector<std::uint32_t>(added, 0));
  for (TrainedGroup* group : anchor_groups()) group->append_copies(any);
  for (const SideRow& row : side_rows_) row.values->resize(row.values->size() + added, 0.0f);
  statistics_.append(added);
  const auto fill = [&](ParameterGroup& group, float value) {
    group.values.edit(first * group.width, [&](std::span<float> rows) { std::ranges::fill(rows, value); });
  };
  fill(offsets_, 0.0f);
  fill(scaling_, log_size);
  features_.values.edit(first * features_.width, [&](std::span<float> rows) {
    std::size_t row = 0;
    for (std::size_t i = 0; i < kept.size(); ++i) {
      if (kept[i] == 0) continue;
      positions_.insert(positions_.end(), &positions[3 * i], &positions[3 * i] + 3);
      std::copy_n(&features[features_.width * i], features_.width, &rows[features_.width * row++]);
    }
  });
  stale_ = anchors_changed_ = true;
  return added;
}

std::array<float, 3> AnchorBackbone::slot_position(std::size_t slot) const {
  const std::size_t anchor = slot / shape_.offsets;
  const std::vector<float>& offsets = device_.is_cuda() ? on_host_.offsets : offsets_.values.host();
  const std::vector<float>& scales = device_.is_cuda() ? on_host_.scales : scales_.host();
  std::array<float, 3> position{};
  for (std::size_t c = 0; c < 3; ++c) {
    position[c] = positions_[3 * anchor + c] + offsets[3 * slot + c] * scales[6 * anchor + c];
  }
  return position;
}

std::span<const float> AnchorBackbone::anchor_feature(std::size_t anchor) const {
  const std::span<const float> all = device_.is_cuda() ? std::span<const float>(on_host_.features) : features_.values;
  return all.subspan(shape_.features * anchor, shape_.features);
}

void AnchorBackbone::remove_anchors(std::span<const std::uint8_t> removed) {
  const Array<std::uint32_t> kept(device_, kept_rows(removed));
  Array<float> workspace(device_);
  select_rows(anchor_groups(), kept, workspace, device_);
  statistics_.select(kept, workspace);
  remove_rows(positions_, 3, removed);
  for (const SideRow& row : side_rows_) remove_rows(*row.values, 1, removed);
  stale_ = anchors_changed_ = true;
}

ScoredView AnchorBackbone::SlotsHook::render_for_score(std::size_t view) {
  const View& truth = owner_.context_.scene.train[view];
  owner_.image_.ensure(truth.color.size());
  owner_.use_embedding_of(&truth);
  owner_.decode(truth.camera, false);
  owner_.draw(truth.camera, owner_.beta_, owner_.image_);
  owner_.rasterizer_.settle();
  return {owner_.image_, owner_.truths_.of(truth)};
}

void AnchorBackbone::SlotsHook::count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts) {
  view_counts_.assign_zeros(owner_.decoded_->count);
  owner_.rasterizer_.count_flagged(flagged, view_counts_);
  add_slot_counts(owner_.decoded_->slots, view_counts_, counts, owner_.device_);
}

void AnchorBackbone::decode_for(const Camera& camera) {
  // A training view has an embedding of its own. A model may be rendered with other views than those of its training.
  const std::vector<View>& train = context_.scene.train;
  const auto same_pose = [&](const View& view) { return view.camera.camera_from_world == camera.camera_from_world; };
  const auto seen = embedding_.rows() == train.size() ? std::ranges::find_if(train, same_pose) : train.end();
  use_embedding_of(seen != train.end() ? &*seen : nullptr);
  decode(camera, false);
}

void AnchorBackbone::render(const Camera& camera, float /*time*/, std::optional<float> beta, std::span<float> color) {
  decode_for(camera);
  if (device_.is_cuda()) image_.ensure(color.size());
  draw(camera, beta ? beta : beta_, device_.is_cuda() ? image_.span() : color);
  rasterizer_.settle();
  if (device_.is_cuda()) image_.cuda().download(color);
}

void AnchorBackbone::render_surface(const Camera& camera, float /*time*/, std::optional<float> beta,
                                    const SurfaceImages& images) {
  decode_for(camera);
  Array<float> color(device_), inverse_depth(device_), alpha(device_);
  color.ensure(images.color.size());
  inverse_depth.ensure(images.depth.size());
  alpha.ensure(images.alpha.size());
  RasterImages there;
  there.color = color;
  there.inverse_depth = inverse_depth;
  there.alpha = alpha;
  draw(camera, beta ? beta : beta_, there);
  rasterizer_.settle();
  std::ranges::copy(color.to_host(), images.color.begin());
  std::ranges::copy(alpha.to_host(), images.alpha.begin());
  std::ranges::copy(inverse_depth.to_host(), images.depth.begin());
  depths_of_inverse(images.alpha, images.depth);
}

std::vector<std::string> AnchorBackbone::model_columns() const {
  std::vector<std::string> names{"x", "y", "z", "nx", "ny", "nz"};
  for (const SideRow& row : side_rows_) names.push_back(row.name);
  const auto add = [&](const std::string& prefix, std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) names.push_back(prefix + std::to_string(i));
  };
  add("f_offset_", offsets_.width);
  add("f_anchor_feat_", features_.width);
  names.emplace_back("opacity");
  add("scale_", 6);
  add("rot_", 4);
  return names;
}

std::uint64_t AnchorBackbone::export_model(const std::filesystem::path& folder) const {
  FloatTable table{model_columns(), {}};
  const std::size_t k = shape_.offsets;
  std::vector<float> offsets_copy, features_copy, scaling_copy, copy;
  const std::span<const float> offsets = offsets_.values.on_host(offsets_copy);
  const std::span<const float> features = features_.values.on_host(features_copy);
  const std::span<const float> scaling = scaling_.values.on_host(scaling_copy);
  for (std::size_t i = 0; i < primitives(); ++i) {
    std::vector<float>& out = table.values;
    out.insert(out.end(), &positions_[3 * i], &positions_[3 * i] + 3);
    out.insert(out.end(), 3, 0.0f);  // normals: part of the layout, unused
    for (const SideRow& row : side_rows_) out.push_back((*row.values)[i]);
    const float* offset = &offsets[3 * k * i];
    for (std::size_t c = 0; c < 3; ++c) {  // the layout's order: all x, all y, all z
      for (std::size_t j = 0; j < k; ++j) out.push_back(offset[3 * j + c]);
    }
    const auto append = [&](std::span<const float> values, std::size_t width) {
      out.insert(out.end(), &values[width * i], &values[width * i] + width);
    };
    append(features, features_.width);
    out.push_back(kLogitTenth);
    append(scaling, scaling_.width);
    out.insert(out.end(), {1.0f, 0.0f, 0.0f, 0.0f});
  }
  const std::filesystem::path anchors = folder / "point_cloud.ply", nets = folder / kNetsFile;
  write_float_ply(anchors, table);
  ArchiveWriter archive;
  for (const TrainedGroup* group : groups_) {
    if (group->width == 1 || group == &embedding_) archive.put(group->name, group->values.on_host(copy));
  }
  for (const Constant& constant : constants_) archive.put(constant.name, std::span<const float>(constant.value, 1));
  write_second_file(anchors, [&] { archive.write(nets); });
  return std::filesystem::file_size(anchors) + std::filesystem::file_size(nets);
}

void AnchorBackbone::import_model(const std::filesystem::path& folder) {
  const FloatTable table = read_float_ply(folder / "point_cloud.ply", model_columns());
  const std::size_t k = shape_.offsets, width = table.names.size(), n = table.rows();
  require(n > 0, (folder / "point_cloud.ply").string() + ": contains no anchors");
  positions_.clear();
  std::vector<float> offsets(3 * k * n), features, scaling;
  for (const SideRow& row : side_rows_) row.values->resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    const float* from = &table.values[width * i];
    positions_.insert(positions_.end(), from, from + 3);
    from += 6;
    for (const SideRow& row : side_rows_) (*row.values)[i] = *from++;
    for (std::size_t c = 0; c < 3; ++c) {
      for (std::size_t j = 0; j < k; ++j) offsets[3 * (k * i + j) + c] = *from++;
    }
    features.insert(features.end(), from, from + features_.width);
    from += features_.width + 1;
    scaling.insert(scaling.end(), from, from + 6);
  }
  offsets_.assign(std::move(offsets));
  features_.assign(std::move(features));
  scaling_.assign(std::move(scaling));

  require_second_file(folder / kNetsFile);
  const ArchiveReader archive(folder / kNetsFile);
  for (TrainedGroup* group : groups_) {
    if (group->width != 1 && group != &embedding_) continue;
    std::vector<float> values = archive.floats(group->name);
    // A model may be rendered with other views than those of training, so the number of embeddings may differ.
    const bool fits = group == &embedding_ ? !values.empty() && values.size() % group->width == 0
                                           : values.size() == group->values.size();
    require(fits, archive.path().string() + ": " + group->name +
                      " does not have the size given by the settings; use the config.json of this model");
    group->assign(std::move(values));
  }
  for (const Constant& constant : constants_) {
    const std::vector<float> value = archive.floats(constant.name);
    require(value.size() == 1, archive.path().string() + ": " + constant.name + " must be one number");
    *constant.value = value[0];
  }
  statistics_.reset(n);
  iteration_ = context_.iterations;  // a finished model: all levels are in use
  mean_embedding_.ensure(0);
  stale_ = anchors_changed_ = true;
}

void AnchorBackbone::save(ArchiveWriter& archive) const {
  archive.put("anchors.iteration", std::int64_t{iteration_});
  archive.put("anchors.config", config().dump());
  archive.put("anchors.positions", std::span<const float>(positions_));
  for (const TrainedGroup* group : groups_) group->save(archive);
  for (const SideRow& row : side_rows_) archive.put("anchors." + row.name, std::span<const float>(*row.values));
  for (const Constant& constant : constants_) {
    archive.put("anchors." + constant.name, std::span<const float>(constant.value, 1));
  }
  statistics_.save(archive);
}

void AnchorBackbone::load(ArchiveReader& archive) {
  if (archive.text("anchors.config") != config().dump()) {
    throw InputError(archive.path().string() +
                     ": the checkpoint was made with a different backbone config; continue with the same --config");
  }
  positions_ = archive.floats("anchors.positions");
  const std::size_t n = primitives();
  bool fits = n > 0 && positions_.size() == 3 * n;
  for (TrainedGroup* group : groups_) {
    const std::size_t size = group->values.size();
    const bool of_anchors = group == &offsets_ || group == &features_ || group == &scaling_;
    group->load(archive);
    fits = fits && (of_anchors ? group->rows() == n : group->values.size() == size);
  }
  for (const SideRow& row : side_rows_) {
    *row.values = archive.floats("anchors." + row.name);
    fits = fits && row.values->size() == n;
  }
  for (const Constant& constant : constants_) {
    const std::vector<float> value = archive.floats("anchors." + constant.name);
    fits = fits && value.size() == 1;
    if (value.size() == 1) *constant.value = value[0];
  }
  fits = statistics_.load(archive, n) && fits;
  if (!fits) throw InputError(archive.path().string() + ": tensor sizes do not match; the checkpoint is damaged");
  iteration_ = static_cast<int>(archive.integer("anchors.iteration"));
  mean_embedding_.ensure(0);
  stale_ = anchors_changed_ = true;
}

}  // namespace splatboost
