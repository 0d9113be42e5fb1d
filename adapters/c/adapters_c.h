/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file The adapters' decisions through the C ABI: which primitives of a host grow, split and are removed, and when its
 * parameter groups step. There is one adapter per backbone, with the rules of the in-tree backbone.
 *
 * The host keeps its tensors and its renderer. It passes callbacks that render its views (sb_views), queries the
 * adapter at each iteration, and receives masks. Memory, tensors and errors: as in splatboost/c_api.h.
 */
#ifndef SPLATBOOST_ADAPTERS_C_H_
#define SPLATBOOST_ADAPTERS_C_H_

#include "splatboost/c_api.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Settings of an adapter by name: parts and constants of the method. They are documented in the adapter's header, such
 *  as vanilla/vanilla_adapter.h. */
typedef struct sb_boost sb_boost;

/** Kinds of settings. All are set and read as double, which represents each of them exactly. */
enum { SB_SETTING_BOOL = 0, /**< 0 or 1 */ SB_SETTING_INTEGER = 1, SB_SETTING_REAL = 2 };

/** Creates the settings of a backbone's adapter. @param literal 0: the defaults, 1: the paper's rules and numbers
 *  @param backbone "vanilla", "mip-splatting", "dropgaussian", … as for the program's --backbone; the error message for
 *  an unknown one lists all @param boost receives the handle, which the caller frees by sb_boost_destroy */
SB_API sb_status sb_boost_create(const char* backbone, int32_t literal, sb_boost** boost);
/** Frees the handle; NULL is allowed. */
SB_API void sb_boost_destroy(sb_boost* boost);
/** Lists the settings. @param index from 0 @param name receives the setting's name, valid as long as the library is
 *  loaded; NULL past the last setting
 *  @param kind receives SB_SETTING_…; NULL is allowed */
SB_API sb_status sb_boost_setting(const sb_boost* boost, int32_t index, const char** name, int32_t* kind);
SB_API sb_status sb_boost_get(const sb_boost* boost, const char* name, double* value);
/** Invalid values are rejected here or by sb_adapter_create(). "literal" cannot be changed: sb_boost_create() sets it.
 *  A host sets what it knows of the run, where the adapter has the setting: "training_views" (their number),
 *  "random_points" (1 if it starts from random points) and "depth_ratio" (the typical depth of the scene in its views,
 *  divided by its extent). Adapters use all. */
SB_API sb_status sb_boost_set(sb_boost* boost, const char* name, double value);

typedef struct sb_adapter sb_adapter;

/** @param boost is copied @param seed of the random draws @param device where the host's images, masks and counts are;
 *  its stream is not kept @param adapter receives the handle, which the caller frees by sb_adapter_destroy */
SB_API sb_status sb_adapter_create(const sb_boost* boost, uint64_t seed, const sb_device* device, sb_adapter** adapter);
/** Frees the handle; NULL is allowed. */
SB_API void sb_adapter_destroy(sb_adapter* adapter);

/** The host's statistics of its primitives; tensors are float32 [N] or [N,1]. Those not needed may be NULL. */
typedef struct sb_density {
  int32_t iteration, total;       /**< current iteration, from 1, and length of the host's run */
  float scene_extent;             /**< 1.1 · largest distance of a training camera from their mean, world units */
  const sb_tensor* gradients;     /**< mean norm of the signed screen-space gradient, NDC units; for growth */
  const sb_tensor* gradients_abs; /**< of the absolute gradient (Mip-Splatting: its sums); for growth with absgrad */
  const sb_tensor* opacities;     /**< activated, in [0, 1]; for pruning, of the M primitives present then */
  const sb_tensor* max_scales;    /**< longest standard deviation, world units; for growth with absgrad */
  int64_t max_primitives;         /**< cap that growth does not exceed, a clone or split adding one; 0: no cap. For
                                   *   late pruning too, which removes none if growth has reached it */
  const sb_tensor* clearances;    /**< of sb_camera_clearances(), for pruning, of the M primitives present then; NULL:
                                   *   none is removed because it is near a camera */
} sb_density;

/** A view rendered without randomness (dropout, jitter) and settled (sb_rasterizer_settle). The tensors must stay valid
 *  until the next render or until the calling entry returns. */
typedef struct sb_scored_view {
  const sb_tensor* color; /**< float32 [3,H,W] */
  sb_truth truth;
} sb_scored_view;

/** The host's renderer. The functions return 0 on success; any other value fails the call with SB_ERROR_CALLBACK. */
typedef struct sb_views {
  void* context;      /**< passed to each function */
  int64_t primitives; /**< N */
  int64_t views;      /**< number of training views that may be scored, numbered from 0 */
  int32_t (*render)(void* context, int64_t view, sb_scored_view* scored);
  /** Adds to counts (int32 [N]) the number of flagged pixels (uint8 [H,W]) in which each primitive was blended in the
   *  last render. */
  int32_t (*count_flagged)(void* context, const sb_tensor* flagged, const sb_tensor* counts);
  /** Adds to weights (int32 [N]) each primitive's blending weights in the last render, as sb_rasterizer_add_weights.
   *  Adapters of Gaussians and of convexes call it once, when growth has ended (late_share), and those of Gaussians at
   *  each growth that reaches a cap (replaced_share). May be NULL for those of anchors, with the literal rules, and if
   *  both shares are 0 (and late_share_random, where there is one). */
  int32_t (*add_weights)(void* context, const sb_tensor* weights);
} sb_views;

/** @param beta receives β of the compact box; 0 if the host is to keep its own box */
SB_API sb_status sb_adapter_beta(const sb_adapter* adapter, float* beta);
/** Whether to grow at this iteration. May be asked in advance, like the questions on pruning, steps and resets.
 *  @param host_would whether the host's own rule would @param grows receives 1 or 0 */
SB_API sb_status sb_adapter_grows_at(const sb_adapter* adapter, int32_t iteration, int32_t total, int32_t host_would,
                                     int32_t* grows);
/** Whether to prune at this iteration. @param prunes receives 1 or 0 */
SB_API sb_status sb_adapter_prunes_at(const sb_adapter* adapter, int32_t iteration, int32_t total, int32_t host_would,
                                      int32_t* prunes);
/** Whether a parameter group steps now. @param group the host's name: "xyz", "f_dc", "f_rest", "opacity", "scaling",
 *  "rotation" @param steps receives 1 or 0 */
SB_API sb_status sb_adapter_steps_at(const sb_adapter* adapter, const char* group, int32_t iteration, int32_t total,
                                     int32_t* steps);

/** Factor on the host's own learning rate of a group at this iteration. @param factor receives it; 1 for most groups */
SB_API sb_status sb_adapter_rate_factor(const sb_adapter* adapter, const char* group, int32_t iteration, int32_t total,
                                        float* factor);
/** Whether the host adds the values of all parameters after the steps of this iteration to their averages, which
 * replace them at the end of the run; a host need not. @param averages receives 1 or 0 */
SB_API sb_status sb_adapter_averages_at(const sb_adapter* adapter, int32_t iteration, int32_t total, int32_t* averages);
/** Whether the host's candidates in growth at this iteration include primitives that are large in the world.
 *  @param host_would whether the host's own rule would include them @param prunes receives 1 or 0 */
SB_API sb_status sb_adapter_prunes_large_at(const sb_adapter* adapter, int32_t iteration, int32_t total,
                                            int32_t host_would, int32_t* prunes);
/** Whether to reset opacities at this iteration. @param host_would whether the host's own rule would
 *  @param resets receives 1 or 0 */
SB_API sb_status sb_adapter_resets_opacities_at(const sb_adapter* adapter, int32_t iteration, int32_t total,
                                                int32_t host_would, int32_t* resets);

/** Scores the views and decides growth; waits for the GPU. Gradients must not be NaN if there is a cap.
 *  @param clone,split uint8 [N], in: the host's own decisions, out: those to apply @param stream CUDA stream of this
 *  call, which the functions of `views` must use too; NULL on the CPU */
SB_API sb_status sb_adapter_grow(sb_adapter* adapter, const sb_density* density, const sb_views* views,
                                 const sb_tensor* clone, const sb_tensor* split, void* stream);
/** Decides removal; waits for the GPU. @param remove uint8 [M], in: the host's own candidates, out: those to remove
 *  @param origins int32 [M] index that each primitive, or the one it was made from, had in sb_adapter_grow of this
 *  iteration, before any late pruning of it. NULL if not within growth: then late pruning adds candidates, by the
 *  scores of the views and the opacities, at its own iterations (sb_adapter_prunes_at with host_would 0); at all
 *  others `remove` stays unchanged, except for primitives whose clearance is below the setting min_clearance
 *  @param stream as for sb_adapter_grow */
SB_API sb_status sb_adapter_prune(sb_adapter* adapter, const sb_density* density, const sb_views* views,
                                  const sb_tensor* remove, const sb_tensor* origins, void* stream);

#ifdef __cplusplus
}
#endif

#endif /* SPLATBOOST_ADAPTERS_C_H_ */
