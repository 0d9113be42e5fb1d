/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file The adapters' decisions through the C ABI: which primitives of a host grow, split and go, and when its
 * parameter groups step. There is an adapter for each folder of adapters/; its rules are those of the in-tree backbone.
 *
 * The host keeps its tensors and its renderer. It shows its views by two functions (sb_views), asks at each iteration,
 * and gets masks. Rules of memory, tensors and errors: splatboost/c_api.h.
 */
#ifndef SPLATBOOST_ADAPTERS_C_H_
#define SPLATBOOST_ADAPTERS_C_H_

#include "splatboost/c_api.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Settings of an adapter by name: parts and constants of the method. The header of the adapter, such as
 *  vanilla/vanilla_adapter.h, says what each is. */
typedef struct sb_boost sb_boost;

/** Kinds of settings. All are given and read as a double, which holds each exactly. */
enum { SB_SETTING_BOOL = 0, /**< 0 or 1 */ SB_SETTING_INTEGER = 1, SB_SETTING_REAL = 2 };

/** The settings of a backbone's adapter. @param literal 0: the default, 1: the paper's rules and numbers
 *  @param backbone "vanilla", "mip-splatting", "dropgaussian", … as the
 *  program's --backbone; the message of a refusal names all */
SB_API sb_status sb_boost_create(const char* backbone, int32_t literal, sb_boost** boost);
/** NULL is allowed. */
SB_API void sb_boost_destroy(sb_boost* boost);
/** @param index from 0 @param name receives the setting's name, which lives as long as the library; NULL past the last
 *  @param kind receives SB_SETTING_…; NULL is allowed */
SB_API sb_status sb_boost_setting(const sb_boost* boost, int32_t index, const char** name, int32_t* kind);
SB_API sb_status sb_boost_get(const sb_boost* boost, const char* name, double* value);
/** Values that no run can have are refused here or by sb_adapter_create(). */
SB_API sb_status sb_boost_set(sb_boost* boost, const char* name, double value);

typedef struct sb_adapter sb_adapter;

/** @param boost is copied @param seed of the draws @param device where the host's images, masks and counts are; its
 * stream is not kept */
SB_API sb_status sb_adapter_create(const sb_boost* boost, uint64_t seed, const sb_device* device, sb_adapter** adapter);
/** NULL is allowed. */
SB_API void sb_adapter_destroy(sb_adapter* adapter);

/** What a host knows of its primitives at a moment, float32 [N] each. */
typedef struct sb_density {
  int32_t iteration, total;       /**< of the host's run, from 1 */
  float scene_extent;             /**< radius of the camera positions, world units */
  const sb_tensor* gradients;     /**< mean norm of the signed screen gradient, NDC units; for growth */
  const sb_tensor* gradients_abs; /**< of the absolute one (Mip-Splatting: its sums); for growth with absgrad */
  const sb_tensor* opacities;     /**< activated; for pruning, of the M primitives that are there then */
  const sb_tensor* max_scales;    /**< longest standard deviation, world units; for growth with absgrad */
  int64_t max_primitives;         /**< growth makes no more of them, a clone or split adding one; 0: no cap */
} sb_density;

/** A view as rendered without anything random, and settled (sb_rasterizer_settle). The tensors live until the next
 *  render or the entry's return. */
typedef struct sb_scored_view {
  const sb_tensor* color; /**< float32 [3,H,W] */
  sb_truth truth;
} sb_scored_view;

/** The host's renderer. The functions return 0, or anything else to fail the call with SB_ERROR_CALLBACK. */
typedef struct sb_views {
  void* context;      /**< given to each */
  int64_t primitives; /**< N */
  int64_t views;      /**< training views that may be scored, numbered from 0 */
  int32_t (*render)(void* context, int64_t view, sb_scored_view* scored);
  /** Adds to counts (int32 [N]) the flagged pixels (uint8 [H,W]) where each primitive was blended in the last render.
   */
  int32_t (*count_flagged)(void* context, const sb_tensor* flagged, const sb_tensor* counts);
  /** Adds to weights (int32 [N]) each primitive's blending weights in the last render, as sb_rasterizer_add_weights.
   *  Adapters of Gaussians ask for them when growth has ended (late_share); those of anchors and convexes never do, and
   *  it may be NULL. */
  int32_t (*add_weights)(void* context, const sb_tensor* weights);
} sb_views;

/** @param beta of the compact box; 0 where the box is to stay the host's own */
SB_API sb_status sb_adapter_beta(const sb_adapter* adapter, float* beta);
/** @param host_would whether the host's own rule would grow now @param grows receives 1 or 0 */
SB_API sb_status sb_adapter_grows_at(const sb_adapter* adapter, int32_t iteration, int32_t total, int32_t host_would,
                                     int32_t* grows);
/** @param prunes receives 1 or 0 */
SB_API sb_status sb_adapter_prunes_at(const sb_adapter* adapter, int32_t iteration, int32_t total, int32_t host_would,
                                      int32_t* prunes);
/** @param group the host's name: "xyz", "f_dc", "f_rest", "opacity", "scaling", "rotation" @param steps receives 1 or 0
 */
SB_API sb_status sb_adapter_steps_at(const sb_adapter* adapter, const char* group, int32_t iteration, int32_t total,
                                     int32_t* steps);

/** What the host's own learning rate of a group is multiplied by now. @param factor receives it, 1 for most */
SB_API sb_status sb_adapter_rate_factor(const sb_adapter* adapter, const char* group, int32_t iteration, int32_t total,
                                        float* factor);
/** Whether opacities are reset now. @param host_would whether the host's own rule would @param resets receives 1 or 0
 */
SB_API sb_status sb_adapter_resets_opacities_at(const sb_adapter* adapter, int32_t iteration, int32_t total,
                                                int32_t host_would, int32_t* resets);

/** Scores the views and decides growth; waits for the GPU. @param clone,split uint8 [N], come with the host's own
 *  decisions @param stream of this call, which the functions of `views` must draw on too; NULL on the CPU */
SB_API sb_status sb_adapter_grow(sb_adapter* adapter, const sb_density* density, const sb_views* views,
                                 const sb_tensor* clone, const sb_tensor* split, void* stream);
/** Decides removal; waits for the GPU. @param remove uint8 [M], comes with the host's own candidates
 *  @param origins int32 [M] index that each primitive, or the one it was made from, had in the grow of this iteration;
 *  NULL: not within growth. Then the late rule adds to the candidates, from scores of the views and the opacities, at
 *  its own iterations (sb_adapter_prunes_at with host_would 0); at all others nothing changes
 *  @param stream as for growth */
SB_API sb_status sb_adapter_prune(sb_adapter* adapter, const sb_density* density, const sb_views* views,
                                  const sb_tensor* remove, const sb_tensor* origins, void* stream);

#ifdef __cplusplus
}
#endif

#endif /* SPLATBOOST_ADAPTERS_C_H_ */
