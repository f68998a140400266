#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <string>
#include <vector>

namespace stillmap::test {

/// A callable throws `Exception`, and its message holds every text given.
///
///     EXPECT_THAT([&] { read(file); }, ThrowsSaying<InputError>({file.string(), "expected 12"}));
template <typename Exception>
[[nodiscard]] ::testing::Matcher<const std::function<void()>&> ThrowsSaying(
    const std::vector<std::string>& texts) {
  std::vector<::testing::Matcher<std::string>> each;
  for (const std::string& text : texts) each.emplace_back(::testing::HasSubstr(text));
  return ::testing::Throws<Exception>(
      ::testing::ResultOf([](const Exception& error) { return std::string(error.what()); },
                          ::testing::AllOfArray(each)));
}

}  // namespace stillmap::test
