#include "bags/bag_choice.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/recording_choice.hpp>

#include <algorithm>
#include <array>
#include <utility>

#include <stillmap/maps/text.hpp>

namespace stillmap::maps {
namespace {

constexpr std::string_view kExpected =
    "cloud=TOPIC (or TOPIC,TOPIC for several lidars), poses=TOPIC, pose_frame=FRAME, gnss=TOPIC, "
    "imu=TOPIC, points=map, stamps=recorded or calibration=FILE";

struct ChoiceWord {
  std::string_view name;
  std::optional<std::string> BagChoice::*value;
};
constexpr std::array<ChoiceWord, 8> kChoiceWords{{{"cloud", &BagChoice::cloud},
                                                  {"poses", &BagChoice::poses},
                                                  {"pose_frame", &BagChoice::pose_frame},
                                                  {"gnss", &BagChoice::gnss},
                                                  {"imu", &BagChoice::imu},
                                                  {"points", &BagChoice::points},
                                                  {"stamps", &BagChoice::stamps},
                                                  {"calibration", &BagChoice::calibration}}};

std::optional<std::string>* find_word(BagChoice& choice, std::string_view name) {
  const auto* const word = std::ranges::find(kChoiceWords, name, &ChoiceWord::name);
  return word == kChoiceWords.end() ? nullptr : &(choice.*word->value);
}

/// @param own  what counts where the choice says nothing.
BagChoice with_own_words(BagChoice choice, const BagChoice& own) {
  for (const ChoiceWord& word : kChoiceWords)
    if (!(choice.*word.value)) choice.*word.value = own.*word.value;
  return choice;
}

}  // namespace

BagChoice parse_bag_choice(std::string_view text, const std::string& source) {
  BagChoice choice;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find_first_of("&\r\n"), text.size());
    const std::string_view part = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
    if (part.empty()) continue;
    const std::size_t sign = part.find('=');
    std::optional<std::string>* const word =
        sign == std::string_view::npos ? nullptr : find_word(choice, part.substr(0, sign));
    if (word == nullptr || word->has_value())
      throw InputError(source, "'" + std::string(part.substr(0, 100)) + "'",
                       std::string(kExpected) + ", each once");
    *word = std::string(part.substr(sign + 1));
  }
  if (choice.stamps && *choice.stamps != "header" && *choice.stamps != "recorded")
    throw InputError(source, "'stamps=" + choice.stamps->substr(0, 100) + "'",
                     "stamps=header or stamps=recorded");
  return choice;
}

BagChoice with_choice_of_folder(BagChoice choice, const std::filesystem::path& folder) {
  const std::filesystem::path file = folder / "topics.txt";
  if (!std::filesystem::exists(file)) return choice;
  return with_own_words(std::move(choice), parse_bag_choice(read_text(file), file.string()));
}

void check_recording_choice(std::string_view words, const std::string& source) {
  static_cast<void>(parse_bag_choice(words, source));
}

std::string merged_recording_choice(std::string_view words, std::string_view own,
                                    const std::string& source) {
  const BagChoice choice =
      with_own_words(parse_bag_choice(words, source), parse_bag_choice(own, source));
  std::string text;
  for (const ChoiceWord& word : kChoiceWords)
    if (const std::optional<std::string>& value = choice.*word.value)
      text += (text.empty() ? "" : "&") + std::string(word.name) + "=" + *value;
  return text;
}

std::optional<std::filesystem::path> file_beside(const std::filesystem::path& bag,
                                                 const std::string& name) {
  const std::filesystem::path file(name);
  if (name.empty() || file != file.filename() || name == "..") return std::nullopt;
  const std::filesystem::path found =
      (std::filesystem::is_directory(bag) ? bag : bag.parent_path()) / file;
  if (!std::filesystem::is_regular_file(found)) return std::nullopt;
  return found;
}

}  // namespace stillmap::maps
