#pragma once

#include <stillmap/maps/map_package.hpp>

#include <cstddef>
#include <string>

namespace stillmap::mapper {

/// Where the follower of a build in Slurm keeps what it builds, in `slurm_folder`.
inline constexpr const char* kSlurmPlan = "plan";
/// How folders end in which followers work (`slurm_folder`).
inline constexpr const char* kSlurmFolder = ".slurm";

/// By which Slurm knows the jobs of a build. @param plan  the text of its file.
inline std::string slurm_job_name(const std::string& plan) {
  constexpr std::size_t kLetters = 12;
  return "stillmap-" + maps::sha256_of(plan).substr(0, kLetters);
}

}  // namespace stillmap::mapper
