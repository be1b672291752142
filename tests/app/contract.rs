//! Features the window promises, each with the tests that check it. Promises without a test are not listed.

use std::fs;
use std::path::Path;

/// Promises and their tests, as `file: test`: files in `tests/app`, or paths of unit tests in `src/app`.
const PROMISES: &[(&str, &[&str])] = &[
    (
        "Top: Open, Train/Pause with Step and Reset in its menu, Export, and menus; one row, at most 26 controls in all",
        &[
            "menus.rs: every_command_is_in_one_menu",
            "menus.rs: menus_do_what_they_say_and_tell_why_they_cannot",
            "states.rs: a_dataset_goes_through_every_state",
            "first_minute.rs: few_controls_are_visible_and_none_wraps",
        ],
    ),
    (
        "Right: tabs Summary, Quality, Latency, Inspector, Edit, Path, Settings",
        &[
            "states.rs: help_lists_every_shortcut_and_tabs_switch",
            "quality.rs: held_out_views_are_measured_as_eval_does_and_a_click_flies_there",
            "inspect.rs: a_click_shows_the_posterior_and_escape_forgets_it",
            "detail.rs: the_papers_settings_are_typed_in_the_panel_trained_by_and_copied",
        ],
    ),
    (
        "Bottom: frame strip (thumbnails, current frame, error)",
        &[
            "frames.rs: a_click_shows_the_camera_and_a_drag_previews_others",
            "frames.rs: skipped_frames_tell_their_reason_and_trained_ones_how_well",
            "frames.rs: ten_thousand_frames_cost_what_is_on_screen",
            "src/app/viewer/thumbnails.rs: what_is_on_screen_stays_and_the_rest_is_bounded",
            "src/app/frame_outcomes.rs: frames_are_ahead_then_trained_or_skipped_and_others_are_not_taken",
        ],
    ),
    (
        "Bottom: a status line (state, fps, components, memory)",
        &["states.rs: the_status_line_tells_state_pace_components_and_memory"],
    ),
    (
        "Panels dock and their layout persists",
        &[
            "dock.rs: panels_are_dragged_beside_the_picture_and_put_back",
            "dock.rs: a_window_of_any_size_has_its_panels",
            "src/app/layout.rs: layouts_survive_a_restart",
            "src/app/layout.rs: broken_and_older_layouts_fall_back_and_say_so",
            "src/app/layout.rs: panels_keep_their_width_and_the_picture_takes_the_rest",
        ],
    ),
    (
        "Settings persist (RON, versioned, in the platform's config folder); a broken or newer file is set aside",
        &[
            "settings.rs: settings_lie_in_the_config_folder_and_a_newer_file_is_set_aside",
            "src/app/settings_file.rs: half_a_file_gives_way_to_the_last_good_one_and_is_kept",
            "src/app/settings_file.rs: a_newer_file_is_set_aside_as_it_is_and_said",
            "src/app/settings_file.rs: a_part_that_cannot_be_read_leaves_a_copy_of_the_file",
            "src/app/training.rs: settings_survive_a_restart",
            "src/app/viewer/settings.rs: settings_survive_a_restart_but_not_the_colour_mode",
            "src/app/user_folders.rs: the_newest_come_first_and_survive_a_restart",
        ],
    ),
    (
        "States: Empty, Loading, Ready, Training, Paused, Finished, Failed",
        &[
            "states.rs: a_dataset_goes_through_every_state",
            "following.rs: a_recording_is_trained_from_before_its_first_frame_to_its_end",
            "opening.rs: a_dataset_with_bad_frames_trains_on_the_others_and_counts_them",
        ],
    ),
    (
        "What each button does in each state is one table in the code",
        &["src/app/command.rs: in_no_state_is_nothing_possible_and_space_is_never_ambiguous"],
    ),
    (
        "Notices are single lines that cover neither captions nor panels, also at 640×400",
        &["first_minute.rs: notices_are_single_lines_below_the_captions_and_close_together"],
    ),
    (
        "Empty state: a drop target for folders, an Open button, the synthetic scene",
        &["first_minute.rs: the_start_page_says_what_happens_and_how_to_begin"],
    ),
    (
        "Progress is never discarded without confirmation",
        &[
            "states.rs: a_dataset_goes_through_every_state",
            "saving.rs: closing_goes_on_after_the_file_was_written",
            "saving.rs: a_minimised_window_with_something_to_lose_comes_up_and_asks",
            "abandoned.rs: a_killed_run_is_offered_and_goes_on_to_the_same_scene",
        ],
    ),
    (
        "Space train/pause, . one frame, Ctrl+R, Ctrl+O, Ctrl+E, Ctrl+S, F1 all shortcuts",
        &[
            "states.rs: help_lists_every_shortcut_and_tabs_switch",
            "files.rs: export_writes_the_newest_state_and_the_file_opens_again",
            "files.rs: a_saved_run_opens_where_it_stopped_and_goes_on",
        ],
    ),
    (
        "Left drag orbits, right or middle drag pans, wheel dollies, F frames, H goes home",
        &["camera.rs: the_camera_follows_the_pointer_and_keys"],
    ),
    (
        "Double click sets the pivot on the surface",
        &["tools.rs: a_double_click_turns_about_the_surface_where_it_is"],
    ),
    (
        "WASD/QE flies, Shift 10 times faster and Ctrl 10 times slower",
        &["tools.rs: keys_fly_and_with_ctrl_they_fly_slowly_instead_of_saving"],
    ),
    (
        "Tab toggles projected/exact",
        &[
            "viewer.rs: tab_toggles_the_renderer_unless_the_lens_is_a_fisheye",
            "keyboard.rs: tab_is_the_renderers_until_controls_have_the_keyboard",
        ],
    ),
    (
        "[ ] or the arrow keys step through the dataset's cameras, G compares with the photograph",
        &[
            "viewer.rs: photographs_are_stepped_through_and_measured_as_eval_does",
            "switching.rs: no_camera_outlives_its_dataset",
        ],
    ),
    (
        "Keys are ignored while a text field has the focus",
        &["keyboard.rs: a_text_field_keeps_the_keys"],
    ),
    (
        "Overlays: camera frusta, the current frame's points, grid and axes",
        &[
            "tools.rs: cameras_grid_and_points_of_the_current_frame_are_drawn_over_the_scene",
            "src/app/viewer/frame_points.rs: points_lie_where_the_camera_measured_them_in_its_colours",
        ],
    ),
    (
        "Colour modes: colour, evidence, uncertainty, per-point ELBO, birth frame, texture, depth, normal",
        &[
            "inspect.rs: every_colour_that_stands_for_something_is_shown_with_its_legend",
            "src/app/palette.rs: texels_are_coloured_by_share_and_splats_as_0",
        ],
    ),
    (
        "A draggable wipe between projected and exact, with a difference view",
        &["viewer.rs: renderers_are_timed_and_compared_and_the_divider_is_dragged"],
    ),
    (
        "A wipe between render and photograph, with a difference view and the live PSNR",
        &[
            "viewer.rs: photographs_are_stepped_through_and_measured_as_eval_does",
            "compared.rs: a_second_model_is_wiped_to_measured_and_removed",
            "compared.rs: a_second_model_stays_beside_its_recording_and_leaves_with_it",
        ],
    ),
    (
        "Latency: stages, table of median/p95/max, sort and draw times, CSV",
        &[
            "viewer.rs: renderers_are_timed_and_compared_and_the_divider_is_dragged",
            "tools.rs: timings_are_written_beside_the_dataset_and_never_over_a_file",
            "src/app/panels/latency.rs: frames_are_counted_against_the_budget_and_found_under_the_pointer",
            "src/app/panels/latency.rs: csv_has_a_column_per_heading",
        ],
    ),
    (
        "Quality: PSNR/SSIM on held-out views against frames seen and against seconds, components against frames",
        &[
            "quality.rs: held_out_views_are_measured_as_eval_does_and_a_click_flies_there",
            "quality.rs: views_of_a_camera_whose_poses_were_corrected_are_drawn_from_where_it_stood",
        ],
    ),
    (
        "Retention: the PSNR of frames 0, 10, 20, … measured again as training goes on",
        &[
            "quality.rs: held_out_views_are_measured_as_eval_does_and_a_click_flies_there",
            "src/app/retention.rs: few_frames_are_followed_from_the_moment_they_are_trained",
            "quality.rs: every_run_has_curves_of_ten_moments_that_a_checkpoint_keeps",
            "quality.rs: a_textured_run_keeps_ten_scenes_within_the_budget",
        ],
    ),
    (
        "The viewport re-uploads only components that changed since the last upload",
        &[
            "waiting.rs: only_splats_that_changed_are_uploaded",
            "src/app/splat_updates.rs: a_replacement_supersedes_what_waits_and_later_changes_may_add",
        ],
    ),
    (
        "The UI thread never waits for the trainer, a file or the GPU",
        &[
            "waiting.rs: the_window_is_drawn_and_steered_while_a_frame_is_trained",
            "waiting.rs: the_last_picture_stays_while_something_is_opened",
        ],
    ),
    (
        "The trainer never waits for the UI",
        &["waiting.rs: frames_are_trained_while_the_window_does_nothing"],
    ),
    (
        "Training time per frame is the same with the window visible, hidden, minimised, resized, vsync on or off",
        &[
            "waiting.rs: frames_are_trained_while_the_window_does_nothing",
            "window.rs: figures_of_start_up_and_cost",
            "window.rs: a_window_at_rest_costs_nothing_shown_or_hidden",
            "beside_training.rs: figures_beside_training",
        ],
    ),
    (
        "The last image stays on screen while anything loads",
        &["waiting.rs: the_last_picture_stays_while_something_is_opened"],
    ),
    (
        "Export, Save and Finish always use the trainer's newest state",
        &[
            "export_preview.rs: a_file_is_seen_and_measured_before_it_is_written",
            "files.rs: export_writes_the_newest_state_and_the_file_opens_again",
            "files.rs: a_saved_run_opens_where_it_stopped_and_goes_on",
        ],
    ),
    (
        "Every failure gives a message with a remedy; the app continues",
        &[
            "opening.rs: what_cannot_be_opened_is_said_and_what_was_open_stays",
            "opening.rs: a_dataset_that_vanishes_while_it_trains_leaves_what_was_learnt",
            "compared.rs: a_broken_second_model_is_a_notice_and_nothing_else_changes",
            "crash.rs: a_panic_of_training_stores_the_run_and_leaves_the_window",
            "device_loss.rs: at_any_moment_a_lost_device_costs_a_window_and_nothing_else",
            "scene.rs: depth_in_a_wrong_unit_is_said",
        ],
    ),
    (
        "F frames the scene by the smaller field of view, also for opened models",
        &[
            "camera.rs: f_shows_the_whole_scene_and_fills_the_smaller_side",
            "src/app/camera.rs: framing_fits_the_smaller_side_of_the_viewport",
        ],
    ),
    (
        "The picture of the view can be saved to a file",
        &["tools.rs: pictures_have_any_size_and_the_view_is_whole_in_them"],
    ),
    (
        "A full disk gives an error; the scene stays and can be written elsewhere",
        &[
            "full_disk.rs: a_full_disk_is_said_and_the_scene_is_written_elsewhere",
            "full_disk.rs: a_history_that_cannot_be_stored_is_reported_once_with_its_folder",
            "saving.rs: what_waits_is_given_up_where_no_file_was_written",
            "src/app/settings_file.rs: half_a_file_gives_way_to_the_last_good_one_and_is_kept",
        ],
    ),
    (
        "A network folder that hangs gives a warning and can be cancelled; the app continues",
        &[
            "silent_drive.rs: a_drive_that_does_not_answer_is_named_and_given_up_and_nothing_is_lost",
            "silent_drive.rs: something_else_is_opened_while_a_drive_does_not_answer",
            "silent_drive.rs: a_program_that_is_ended_keeps_its_training_and_waits_for_no_drive",
            "silent_drive.rs: a_frame_that_is_never_read_is_named_and_holds_up_nothing",
            "silent_drive.rs: a_recording_that_falls_silent_is_named_and_what_was_learnt_is_saved",
            "silent_drive.rs: a_recording_that_falls_silent_as_it_begins_is_named_and_holds_up_nothing",
        ],
    ),
    (
        "One run in a real window by mouse and keys: open, train, orbit, compare, measure, export, quit",
        &["journey.rs: a_hand_does_all_that_a_capture_needs"],
    ),
    (
        "The scene after frame k can be viewed (from stored copies)",
        &[
            "editing.rs: a_walk_back_shows_the_scene_as_it_was_and_training_goes_on_behind_it",
            "src/app/edit/past.rs: moments_keep_to_the_budget_and_none_is_kept_that_exceeds_it_alone",
            "src/app/edit/past.rs: a_written_scene_is_read_as_it_was",
        ],
    ),
    (
        "A lost device closes only the window, also on a real display",
        &[
            "real_window.rs: a_screen_shows_the_window_and_a_lost_device_the_next_one",
            "device_loss.rs: at_any_moment_a_lost_device_costs_a_window_and_nothing_else",
        ],
    ),
];

/// True if a file contains a test of this name.
fn has_test(file: &str, name: &str) -> bool {
    let file = if file.starts_with("src/") { file.to_owned() } else { format!("tests/app/{file}") };
    let Ok(text) = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(file)) else {
        return false;
    };
    let lines: Vec<&str> = text.lines().map(str::trim).collect();
    let Some(at) = lines.iter().position(|line| line.starts_with(&format!("fn {name}()"))) else {
        return false;
    };
    // Other attributes may lie between `#[test]` and the function.
    lines[..at]
        .iter()
        .rev()
        .take_while(|line| line.starts_with("#["))
        .any(|line| *line == "#[test]")
}

#[test]
fn every_promise_has_its_tests() {
    for (promise, tests) in PROMISES {
        assert!(!tests.is_empty(), "{promise}");
        for test in *tests {
            let (file, name) = test.split_once(": ").unwrap();
            assert!(has_test(file, name), "{promise}: test {test} not found");
        }
    }
    assert!(!has_test("states.rs", "what_nobody_has_written"));
    assert!(!has_test("states.rs", "is"), "a function that is no test");
}
