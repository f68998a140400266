#pragma once

#include "evaluation/paper/paper_pieces.hpp"

#include <stillmap/mapping/paper_evaluation.hpp>

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// One piece that is still to be made.
struct PaperStep {
  std::string title;
  /// Time that it takes beside the others.
  std::size_t effort = 1;
  /// How many stages it tells of.
  std::size_t stages = 1;
  std::function<void(const ProgressCallback& progress)> run;
};

/// What is missing for a table, in the order in which it is made.
class PaperPlan {
 public:
  /// @param options, parts, pieces, cancel  must outlive this and every step.
  /// @param keep  maps and drives stay; else they go as soon as nothing more needs them.
  PaperPlan(const PaperEvaluationOptions& options, const PaperParts& parts,
            const PaperPieces& pieces, bool keep, const CancelFlag& cancel)
      : options_(options), parts_(parts), pieces_(pieces), keep_(keep), cancel_(cancel) {}

  /// @return every answer of the street is there once these are done. Broken pieces are removed.
  [[nodiscard]] std::vector<PaperStep> steps(const PaperStreet& street,
                                             const std::vector<PaperMap>& maps) const;

 private:
  struct Open {
    PaperMap map;
    std::vector<PaperQuestion> questions;
  };
  [[nodiscard]] std::vector<Open> open_maps(const PaperStreet& street,
                                            const std::vector<PaperMap>& maps) const;
  void add_drives(const PaperStreet& street, std::vector<PaperStep>& steps) const;
  void add_map(const PaperStreet& street, const PaperMap& map, bool is_built,
               std::vector<PaperStep>& steps) const;
  [[nodiscard]] PaperStep ask(const PaperStreet& street, const PaperMap& map,
                              const PaperQuestion& question) const;
  void build(const PaperStreet& street, const PaperMap& map,
             const ProgressCallback& progress) const;

  const PaperEvaluationOptions& options_;
  const PaperParts& parts_;
  const PaperPieces& pieces_;
  bool keep_;
  const CancelFlag& cancel_;
};

/// Runs all steps, and tells of them as of one piece of work. @throws what they throw, Cancelled.
void run_steps(const std::vector<PaperStep>& steps, const ProgressCallback& progress,
               const CancelFlag& cancel);

}  // namespace stillmap::mapping
