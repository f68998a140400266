#pragma once

#include <stillmap/maps/error.hpp>

#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace stillmap::maps {

/// A topic of a recording (a label of a rawlog) that a drive can be made of.
struct RecordingTopic {
  /// The word that chooses it: cloud, poses, gnss or imu (`Drive::open`).
  std::string word;
  std::string name;
  /// Type of its messages; empty for a rawlog.
  std::string type;
  /// 0 if they were not counted.
  std::size_t messages = 0;
  /// Frame of the clouds, or frame whose poses they are; empty if the messages do not name it.
  std::string frame_id;
};

/// A recording that cannot be opened as it was chosen, but can be with another choice.
class ChoiceError : public InputError {
 public:
  ChoiceError(const InputError& error, std::vector<RecordingTopic> topics)
      : InputError(error), topics_(std::move(topics)) {}
  /// All that can be chosen; at least one has the word cloud.
  [[nodiscard]] const std::vector<RecordingTopic>& topics() const { return topics_; }

 private:
  std::vector<RecordingTopic> topics_;
};

/// Packets of a sensor whose calibration is missing or of another sensor: `calibration=NAME`
/// chooses one.
class CalibrationError : public InputError {
 public:
  using InputError::InputError;
};

/// Whether a choice can be made there: of a bag or a rawlog, file or folder; not of a folder with
/// `lidars.json`, which has one for each drive in it.
[[nodiscard]] bool takes_recording_choice(const std::filesystem::path& place);

/// Checks the words of a choice, as they stand behind `?` of a drive or in `topics.txt`; whether a
/// recording has what they name is not checked.
/// @param source  for messages. @throws InputError.
void check_recording_choice(std::string_view words, const std::string& source);

/// The words of a choice, and of `own` those that it leaves open, joined by `&` in one order: equal
/// choices are equal texts. @throws InputError naming `source` as `check_recording_choice`.
[[nodiscard]] std::string merged_recording_choice(std::string_view words, std::string_view own,
                                                  const std::string& source);

}  // namespace stillmap::maps
