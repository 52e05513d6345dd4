"""Small mistakes that a test must notice; `run.py` makes them one by one in a copy of the tree."""

from __future__ import annotations

from dataclasses import dataclass

EVALUATION, METRICS, TABLES = (f"tests/benchmark/test_{name}.py" for name in ("evaluation", "metrics", "tables"))
PAPER, LOCALIZER, MATCHING = (f"tests/vision/test_{name}.py" for name in ("paper_system", "localizer", "matching"))
STEREO, CONFIRMATION, CANDIDATES, PAIRS = (
    f"tests/vision/test_{name}.py" for name in ("stereo_pose", "confirmation", "candidates", "fragment_pairs")
)
EPISODE, CELL, SENSOR = (f"tests/benchmark/test_{name}.py" for name in ("episode_steps", "cell", "sensor"))


@dataclass(frozen=True)
class Mutation:
    """A mistake.

    Attributes:
        what: it does.
        file: from the root of the repository.
        old: text that occurs once in it.
        new: what takes its place.
        tests: node ids of fast tests of which one at least is to fail.
        in_kernel: the mistake is in code that Numba compiles.
    """

    what: str
    file: str
    old: str
    new: str
    tests: tuple[str, ...]
    in_kernel: bool = False


def _of(file: str, *rows: tuple[str, str, str, str], in_kernel: bool = False) -> tuple[Mutation, ...]:
    """Mutations of one file; what, old, new, and the node ids of the tests with a space between."""
    return tuple(Mutation(what, file, old, new, tuple(tests.split()), in_kernel) for what, old, new, tests in rows)


MUTATIONS: tuple[Mutation, ...] = (
    # The paper's system.
    *_of(
        "vision/paper/localizer.py",
        (
            "the taught strategy is ignored",
            'self.name == "previous" or c.extractor == "region"',
            "True",
            f"{PAPER}::test_plates_are_localised_by_stereo",
        ),
        (
            "the predecessor groups edges too",
            'self.name == "previous" or c.extractor == "region"',
            'c.extractor == "region"',
            f"{PAPER}::test_plates_are_localised_by_stereo",
        ),
        (
            "nothing has to verify a hypothesis",
            "if len(seen) >= self.parameters.fewest_supporting or not model.supporting:",
            "if True:",
            f"{PAPER}::test_what_has_no_supporting_feature_is_no_plate",
        ),
        (
            "parts are found twice",
            "if not shared and self._is_apart(T, accepted, model):",
            "if True:",
            f"{PAPER}::test_plates_are_localised_by_stereo",
        ),
        (
            "the turn that supporting features tell is not taken",
            "T = turned(found.T_world_part, turn)",
            "T = found.T_world_part",
            f"{PAPER}::test_plates_are_localised_by_stereo",
        ),
    ),
    *_of(
        "vision/paper/region_growing.py",
        (
            "regions are not pruned",
            "if allowed.any():",
            "if True:",
            f"{PAPER}::test_regions_are_pruned_by_every_attribute_that_was_taught",
        ),
        (
            "circularity prunes nothing",
            '        "circularity": (smaller, 1 / smaller),\n',
            "",
            f"{PAPER}::test_regions_are_pruned_by_every_attribute_that_was_taught",
        ),
        (
            "the deviation of the grey levels prunes nothing",
            '        "grey_deviation": (1 / grey**2, grey**2),\n',
            "",
            f"{PAPER}::test_regions_are_pruned_by_every_attribute_that_was_taught",
        ),
    ),
    *_of(
        "vision/paper/edge_grouping.py",
        (
            "the size constraint is dropped",
            "if not size_px[0] <= major <= size_px[1] or share < parameters.min_share:",
            "if share < parameters.min_share:",
            f"{PAPER}::test_grouping_finds_what_has_the_right_size",
        ),
        (
            "every pair of fragments is compatible",
            "compatible[pairs[:, 0], pairs[:, 1]] = compatible[pairs[:, 1], pairs[:, 0]] = True",
            "compatible[:] = True",
            f"{PAPER}::test_a_group_is_of_compatible_fragments",
        ),
        (
            "groups are not rejected by their fitting error",
            "if state is not None and state.fitting_error(z) <= parameters.max_fitting_error_px:",
            "if state is not None:",
            f"{PAPER}::test_a_fragment_that_does_not_fit_leaves_its_group",
        ),
    ),
    *_of(
        "vision/paper/ellipse_filter.py",
        (
            "the foci always start in the centroid",
            "if foci_in_centroid:",
            "if True:",
            f"{PAPER}::test_foci_that_start_in_the_centroid_stay_together_but_for_rounding",
        ),
    ),
    *_of(
        "vision/paper/ellipse_filter.py",
        (
            "the filter's update is skipped",
            "        p -= gain * residual\n",
            "",
            f"{PAPER}::test_the_update_is_that_of_filterpy",
        ),
        in_kernel=True,
    ),
    *_of(
        "vision/paper/supporting.py",
        (
            "a magnified window is off by half a pixel",
            "offset = (scale - 1) / 2",
            "offset = 0.0",
            f"{PAPER}::test_a_magnified_window_shows_a_point_where_its_camera_says",
        ),
        (
            "supporting features of any size count",
            "np.flatnonzero(near & alike)",
            "np.flatnonzero(near)",
            f"{PAPER}::test_a_sighting_has_the_size_and_the_place_of_a_feature",
        ),
        (
            "supporting features anywhere count",
            "np.flatnonzero(near & alike)",
            "np.flatnonzero(alike)",
            f"{PAPER}::test_a_sighting_has_the_size_and_the_place_of_a_feature",
        ),
    ),
    # What both systems stand on.
    *_of(
        "vision/grouping/hypotheses.py",
        (
            "the convexity constraint is dropped",
            "margin[b] >= -slack\n                and ",
            "",
            f"{PAIRS}::test_fragments_that_bulge_apart_are_no_pair",
        ),
        (
            "the grey-level constraint is dropped",
            "and _similar(grey, brighter, i, j, tolerance)\n",
            "\n",
            f"{PAIRS}::test_fragments_of_unlike_grey_are_no_pair",
        ),
        (
            "the size constraint on pairs is dropped",
            "                and _size_ok(endpoints[a], endpoints[b], max_extent)\n",
            "",
            f"{PAIRS}::test_fragments_too_far_apart_are_no_pair",
        ),
        in_kernel=True,
    ),
    *_of(
        "vision/pose/stereo.py",
        (
            "the base line points backwards",
            "base = origins[1] - origins[0]",
            "base = origins[0] - origins[1]",
            f"{STEREO}::test_rays_meet_where_they_were_aimed",
        ),
        (
            "the quaternion turns the other way",
            "rotation = Rotation.from_quat([x, y, z, w0])",
            "rotation = Rotation.from_quat([x, y, z, -w0])",
            f"{STEREO}::test_absolute_orientation_recovers_any_pose",
        ),
        (
            "rays do not take the camera's turn",
            "view.camera.rays(pixels) @ view.T_world_camera.as_matrix()[:3, :3].T",
            "view.camera.rays(pixels)",
            f"{STEREO}::test_exact_ellipses_give_the_exact_pose",
        ),
        (
            "wrong matches are kept",
            "kept = (off[nearer] < farthest_m) & (crossing > LEAST_CROSSING)",
            "kept = np.isfinite(off[nearer]) & (crossing > LEAST_CROSSING)",
            f"{STEREO}::test_a_wrong_match_is_left_out",
        ),
    ),
    *_of(
        "vision/geometry/circle.py",
        (
            "circles face away from the camera",
            "normals *= -np.sign(",
            "normals *= np.sign(",
            "tests/vision/test_circle_pose.py::test_both_candidates_have_the_same_image_and_face_the_camera",
        ),
        (
            "a moved circle keeps its normal",
            "T[:3, :3] @ self.normal, self.radius_m)",
            "self.normal, self.radius_m)",
            "tests/vision/test_circle_pose.py::test_a_moved_circle_lies_where_its_points_are_moved_to",
        ),
    ),
    *_of(
        "vision/geometry/camera.py",
        (
            "the principal point is half a pixel off",
            "cx=(width_px - 1) / 2,",
            "cx=width_px / 2,",
            f"{SENSOR}::test_camera_model_agrees_with_the_renderer_within_a_twentieth_of_a_pixel",
        ),
        (
            "distortion is left in the picture",
            "if not any(self.camera.distortion):",
            "if True:",
            "tests/vision/test_camera.py::test_the_undistorted_image_is_that_of_opencv_each_time",
        ),
    ),
    *_of(
        "vision/matching/candidates.py",
        (
            "the height of a circle on the part has the wrong sign",
            "+ T[:3, 3] - height * axis",
            "+ T[:3, 3] + height * axis",
            f"{CANDIDATES}::test_the_true_pose_wins",
        ),
        (
            "backs are taken for fronts",
            "axis = side * normals",
            "axis = normals",
            f"{MATCHING}::test_a_plate_on_its_face_is_found_so_and_its_turn_is_unknown",
        ),
    ),
    # This project's localizer.
    *_of(
        "vision/localizer.py",
        (
            "regions are not pruned",
            "    if workspace is None:\n        return None\n    near, far",
            "    if True:\n        return None\n    near, far",
            f"{LOCALIZER}::test_regions_too_small_for_the_part_are_pruned_and_the_rest_is_not",
        ),
        (
            "the size constraint is dropped",
            "if smallest < f.ellipse.semi_axes[0] < largest",
            "if True",
            f"{LOCALIZER}::test_ellipses_have_the_size_of_a_salient_circle_in_the_workspace",
        ),
        (
            "one extractor alone is given the other's ellipses",
            "[f for f in found if f.extractor == extractor]",
            "list(found)",
            f"{LOCALIZER}::test_focal_reports_what_each_extractor_would_have_said_alone",
        ),
    ),
    *_of(
        "vision/matching/matcher.py",
        (
            "the stereo start is dropped",
            "T if start is None else start,",
            "T,",
            f"{MATCHING}::test_on_ellipses_alone_the_pose_starts_from_stereo",
        ),
        (
            "edges are not claimed, and what is behind a part is not hidden",
            "self.scene.claim(final.T_world_part.as_matrix(), contour, self.model, hiding=self.parameters.hiding)",
            "pass",
            f"{MATCHING}::test_a_part_that_was_found_claims_its_edges",
        ),
        (
            "two parts may be in one place",
            "return final.score >= minimum_score and all(",
            "return final.score >= minimum_score or all(",
            f"{MATCHING}::test_no_place_is_taken_twice_and_no_pose_stands_without_support",
        ),
        (
            "what is known of the calibration is not told",
            "            inplane=inplane,\n            calibration=self.parameters.calibration,\n",
            "            inplane=inplane,\n",
            "tests/vision/test_calibration_error.py::test_a_localizer_told_of_the_calibration_is_less_sure_of_the_same_poses",
        ),
    ),
    *_of(
        "vision/matching/scene_edges.py",
        (
            "the turn about the axis always counts as known",
            "bool(stands_out and alone)",
            "True",
            f"{CONFIRMATION}::test_rotation_stays_unknown_where_several_are_supported_alike",
        ),
        (
            "parts are turned the other way",
            "out[:, :3, 0] = cosine * x + sine * y\n    out[:, :3, 1] = cosine * y - sine * x",
            "out[:, :3, 0] = cosine * x - sine * y\n    out[:, :3, 1] = cosine * y + sine * x",
            f"{CONFIRMATION}::test_turning_is_about_the_part_itself",
        ),
        (
            "a part that was found hides nothing",
            "            render_depth(hidden, T_camera_part, reduced, model)\n",
            "",
            f"{CONFIRMATION}::test_what_a_claimed_part_hides_is_not_held_against_a_pose",
        ),
        (
            "what little a part shows is believed",
            "lacking = self.parameters.demand * (least_shown - shown)",
            "lacking = 0.0 * (least_shown - shown)",
            f"{CONFIRMATION}::test_what_little_a_part_shows_must_speak_for_more_than_itself",
        ),
    ),
    *_of(
        "vision/grouping/edge_grouping.py",
        (
            "ellipses are not rejected by their fitting error",
            "if result is None or result.fitting_error_px > parameters.max_error_px:",
            "if result is None:",
            f"{PAIRS}::test_an_ellipse_that_the_filter_does_not_fit_is_discarded",
        ),
    ),
    *_of(
        "vision/grouping/kalman_filter.py",
        (
            "the update is skipped",
            "            posterior[i] += covariance[i, j] * right[j]\n",
            "            posterior[i] += 0.0\n",
            "tests/vision/test_kalman.py::test_the_information_form_gives_the_update_of_the_textbook",
        ),
        in_kernel=True,
    ),
    *_of(
        "vision/pose/refinement.py",
        (
            "outliers weigh as much as any point",
            "weights = (1 - u**2) ** 2",
            "weights = np.ones_like(u)",
            "tests/vision/test_pose_refine.py::test_a_fifth_of_gross_outliers_does_not_move_the_pose",
        ),
        (
            "the rotation about the axis is not held",
            "        if not inplane:\n            # A stiff",
            "        if False:\n            # A stiff",
            "tests/vision/test_pose_refine.py::test_rotation_about_the_axis_is_held_when_asked",
        ),
    ),
    # The benchmark: nobody is told the truth, and nothing is counted that is not so.
    *_of(
        "benchmark/tasks/bench.py",
        (
            "the true camera poses leak to the localizer",
            "localize(sight.views, self._space)",
            "localize([replace(v, T_world_camera=self._cell.camera_truth()) for v in sight.views], self._space)",
            f"{EPISODE}::test_a_localizer_gets_what_the_robot_knows_and_is_judged_by_the_truth",
        ),
    ),
    *_of(
        "benchmark/episodes/referee.py",
        (
            "judged by what the robot believes",
            "View(view.image, view.camera, self._cell.camera_truth(), view.name)",
            "view",
            f"{EPISODE}::test_a_localizer_gets_what_the_robot_knows_and_is_judged_by_the_truth",
        ),
    ),
    *_of(
        "benchmark/episodes/episode.py",
        (
            "a study's calibration error is not applied",
            "return sensor if hand_eye_mm is None else with_hand_eye_error(sensor, hand_eye_mm / 1000)",
            "return sensor",
            f"{EPISODE}::test_the_sensor_of_a_variant_has_its_hand_eye_error",
        ),
    ),
    *_of(
        "benchmark/world/cell.py",
        (
            "the camera's mounting error is known",
            "T_world_flange * self.T_flange_camera * self._hand_eye_error, name)",
            "T_world_flange * self.T_flange_camera, name)",
            f"{CELL}::test_view_knows_its_pose_up_to_the_calibration_error",
        ),
    ),
    *_of(
        "benchmark/world/sensor.py",
        (
            "there is no noise",
            "if config.noise_sigma > 0:",
            "if False:",
            f"{SENSOR}::test_noise_has_the_deviation_of_the_preset",
        ),
        (
            "a true pose is not turned into OpenCV's axes",
            "data.cam_xmat[camera_id].reshape(3, 3) @ _OPENGL_TO_OPENCV",
            "data.cam_xmat[camera_id].reshape(3, 3)",
            f"{SENSOR}::test_camera_model_agrees_with_the_renderer_within_a_twentieth_of_a_pixel",
        ),
    ),
    *_of(
        "benchmark/episodes/evaluation.py",
        (
            "a part may match another type",
            'if estimate.part != piece.part:\n            return float("inf")\n',
            "",
            f"{EVALUATION}::test_a_pose_within_a_tenth_of_the_diameter_matches_and_any_other_is_false",
        ),
        (
            "an extractor is credited with the other's ellipses",
            "if name not in PRESETS or f.extractor in PRESETS[name]",
            "if True",
            f"{EVALUATION}::test_an_extractor_is_credited_with_what_it_found_itself",
        ),
        (
            "circles that face away are asked for",
            "return project_circle(circle, view) if faces else None",
            "return project_circle(circle, view)",
            f"{EVALUATION}::test_a_circle_that_faces_away_is_not_extracted",
        ),
    ),
    *_of(
        "benchmark/episodes/metrics.py",
        (
            "the symmetry is ignored in the MSSD",
            "rotations = _symmetry_rotations(symmetry.fold, T_truth_estimate.rotation)",
            "rotations = _symmetry_rotations(1, T_truth_estimate.rotation)",
            f"{METRICS}::test_turns_about_the_axis_count_modulo_the_symmetry",
        ),
        (
            "one view is enough to be extracted",
            "for iou in circle) >= EXTRACTION_VIEWS for circle",
            "for iou in circle) >= 1 for circle",
            f"{METRICS}::test_extraction_needs_one_circle_in_two_views_above_the_overlap",
        ),
        (
            "false poses are not counted",
            "spare = tuple(i for i in range(len(estimates)) if i not in taken)",
            "spare = ()",
            f"{METRICS}::test_what_is_over_the_limit_or_left_over_is_a_false_positive",
        ),
        (
            "the ellipsoid is that of 5 %",
            "chdtri(error.components, 1 - ELLIPSOID_SHARE)",
            "chdtri(error.components, ELLIPSOID_SHARE)",
            f"{METRICS}::test_errors_drawn_from_the_claimed_covariance_are_chi_square",
        ),
        (
            "rotations are compared in the part's frame",
            "turn = T_world_truth.rotation.apply(nearest.as_rotvec())",
            "turn = nearest.as_rotvec()",
            f"{METRICS}::test_the_normalized_error_is_in_the_frame_of_the_covariance",
        ),
        (
            "the tilt is that of the whole rotation",
            "return 2 * math.atan2(math.hypot(x, y), math.hypot(z, w))",
            "return 2 * math.atan2(math.hypot(x, y, z), abs(w))",
            f"{METRICS}::test_tilt_is_the_angle_of_the_axes_whatever_the_turn",
        ),
    ),
    *_of(
        "benchmark/report/tables.py",
        (
            "pieces outside the bin are in the rates",
            "if p.part == part and p.in_bin and p.visibility >= min_visibility]",
            "if p.part == part and p.visibility >= min_visibility]",
            f"{TABLES}::test_rates_are_counted_over_what_is_visible_enough_and_in_the_bin",
        ),
        (
            "false poses are shares of the right ones",
            "return Rate.of([True] * wrong + [False] * right)",
            "return Rate.of([True] * wrong + [False] * (right - wrong))",
            f"{TABLES}::test_false_poses_are_a_share_of_all_that_were_reported",
        ),
    ),
    *_of(
        "benchmark/report/gate.py",
        (
            "an empty sample passes",
            "passed = value is not None and (",
            "passed = value is None or (",
            "tests/benchmark/test_gate.py::test_an_empty_sample_misses_every_threshold",
        ),
        (
            "rates have a greatest value instead of a least one",
            'return self.key.endswith(("_low", "_min"))',
            'return self.key.endswith(("_max", "_min"))',
            "tests/benchmark/test_gate.py::test_a_threshold_is_met_or_missed",
        ),
    ),
    *_of(
        "benchmark/config.py",
        (
            "all heaps have the fewest pieces",
            "return int(default_rng((seed, fewest, most)).integers(fewest, most, endpoint=True))",
            "return fewest",
            "tests/benchmark/test_config.py::test_heaps_have_as_many_pieces_as_their_seed_says",
        ),
        (
            "all presets share their seeds",
            "return replace(table1, seed=SCENES[name].start, **changes)",
            'return replace(table1, seed=SCENES["table1"].start, **changes)',
            "tests/benchmark/test_seeds.py::test_a_preset_has_seeds_of_its_own",
        ),
    ),
)
