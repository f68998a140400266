#pragma once

namespace stillmap::mapping {

struct Build;
class BuildJournal;
struct MapBuildResult;

/// What a person should look at goes into the build's `warnings`, each when its stage ends.

/// That the work of a killed build was thrown away. What threw the poses away throws the survey
/// away too, and is said once.
void warn_of_discarded(const BuildJournal& journal, MapBuildResult& result);

/// `--pose-time-offset` where no poses are used.
void warn_of_useless_offset(Build& build);
/// What was added to the stamps of poses.
void warn_of_found_offsets(Build& build);
/// Given poses that disagree with the scans; exact poses that are not exact make a map whose walls
/// stand twice.
void warn_of_given_poses(Build& build);
void warn_of_pose_faults(Build& build);

/// Scans that show nothing, and scans at which odometry began anew.
void warn_of_hidden_scans(Build& build);
/// Poses that disagree with the motion that the scans show.
void warn_of_bent_places(Build& build);

/// A `min_range_m` that leaves out much.
void warn_of_near_points(Build& build);
/// Edits that met nothing.
void warn_of_unmatched_edits(Build& build);

}  // namespace stillmap::mapping
