#include "detection/voxelnext/safetensors.hpp"

#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>

#include <cmath>
#include <limits>

#include "support/throws.hpp"
#include "weights_in_memory.hpp"

namespace stillmap::mapping {
namespace safetensors_test {

using maps::InputError;
using test::as_bytes;
using test::SafetensorsParts;
using test::ThrowsSaying;

SafetensorsParts two_tensors() {
  SafetensorsParts parts;
  parts.header["__metadata__"] = {{"made_by", "hand"}};
  parts.add("a", {2, 3}, {1, 2, 3, 4, 5, 6});
  parts.add("b", {}, {-0.25F});
  return parts;
}

/// The file is refused with a message that names it and holds these texts.
void expect_refused(const std::string& file, std::vector<std::string> texts) {
  texts.insert(texts.begin(), "w.safetensors");
  EXPECT_THAT([&] { (void)parse_safetensors(as_bytes(file), "w.safetensors"); },
              ThrowsSaying<InputError>(texts));
}

/// The same with one entry of tensor "a" replaced.
void expect_refused_entry(const std::string& key, const nlohmann::ordered_json& value,
                          std::vector<std::string> texts) {
  SafetensorsParts parts = two_tensors();
  parts.header["a"][key] = value;
  texts.emplace_back("tensor \"a\"");
  expect_refused(parts.bytes(), texts);
}

TEST(Safetensors, ReadsShapesNumbersAndMetadata) {
  const std::string file = two_tensors().bytes();
  const Safetensors read = parse_safetensors(as_bytes(file), "w.safetensors");
  EXPECT_EQ(read.metadata.at("made_by"), "hand");
  EXPECT_EQ(read.tensors.size(), 2U);
  EXPECT_EQ(read.tensors.at("a").shape, (std::vector<std::size_t>{2, 3}));
  EXPECT_EQ(read.tensors.at("a").floats(), (std::vector<float>{1, 2, 3, 4, 5, 6}));
  EXPECT_TRUE(read.tensors.at("b").shape.empty());
  EXPECT_EQ(read.tensors.at("b").floats(), std::vector<float>{-0.25F});
}

TEST(Safetensors, ReadsTensorsInAnyOrderAndAtAnyAlignment) {
  SafetensorsParts parts = two_tensors();
  std::swap(parts.header["a"], parts.header["b"]);
  const std::string file = parts.with_header(parts.header.dump() + " ");
  const std::string odd = "x" + parts.with_header(parts.header.dump() + "  ");
  EXPECT_EQ(parse_safetensors(as_bytes(file), "f").tensors.at("a").floats().at(0), -0.25F);
  EXPECT_EQ(parse_safetensors(as_bytes(odd).subspan(1), "f").tensors.at("b").floats().at(5), 6.0F);
}

TEST(Safetensors, AcceptsAnEmptyFileAndAnEmptyTensor) {
  SafetensorsParts parts;
  EXPECT_TRUE(parse_safetensors(as_bytes(parts.bytes()), "f").tensors.empty());
  parts.add("none", {3, 0}, {});
  const std::string file = parts.bytes();
  EXPECT_TRUE(parse_safetensors(as_bytes(file), "f").tensors.at("none").floats().empty());
}

TEST(Safetensors, WidensEveryHalfExactly) {
  // Every one of the 65536 patterns against the definition: (-1)^s 2^(e-15) (1 + f/1024).
  for (int half = 0; half < 0x10000; ++half) {
    const int exponent = (half >> 10) & 0x1f;
    const int fraction = half & 0x3ff;
    double expected =
        exponent == 0 ? std::ldexp(fraction, -24) : std::ldexp(1024 + fraction, exponent - 25);
    if (exponent == 0x1f) {
      expected = fraction == 0 ? std::numeric_limits<double>::infinity()
                               : std::numeric_limits<double>::quiet_NaN();
    }
    const float found = float_of_half(static_cast<std::uint16_t>(half));
    EXPECT_EQ(std::signbit(found), half >= 0x8000) << half;
    if (std::isnan(expected)) {
      EXPECT_TRUE(std::isnan(found)) << half;
    } else {
      EXPECT_EQ(std::abs(static_cast<double>(found)), expected) << half;
    }
  }
}

TEST(Safetensors, ReadsHalves) {
  SafetensorsParts parts;
  parts.header["h"] = {{"dtype", "F16"}, {"shape", {2}}, {"data_offsets", {0, 4}}};
  parts.tensor_bytes = std::string("\x00\x3c\x00\xc0", 4);
  const std::string file = parts.bytes();
  EXPECT_EQ(parse_safetensors(as_bytes(file), "f").tensors.at("h").floats(),
            (std::vector<float>{1.0F, -2.0F}));
}

TEST(Safetensors, RefusesAFileThatEndsAnywhereButAtItsEnd) {
  const std::string file = two_tensors().bytes();
  for (std::size_t size = 0; size < file.size(); ++size) {
    const std::string cut = file.substr(0, size);
    EXPECT_THROW((void)parse_safetensors(as_bytes(cut), "f"), InputError) << size;
  }
  expect_refused(file + "x", {"29 bytes after the header", "28"});
  expect_refused("", {"0 bytes", "at least 8"});
}

TEST(Safetensors, RefusesAHeaderLengthBeyondTheFileOrTheLimit) {
  for (const std::uint64_t length : {std::uint64_t{1000}, kMaxHeaderBytes + 1, ~std::uint64_t{0},
                                     ~std::uint64_t{0} - 7, std::uint64_t{1} << 63U}) {
    std::string file = two_tensors().bytes();
    std::memcpy(file.data(), &length, 8);
    expect_refused(file, {"header of " + std::to_string(length) + " bytes"});
  }
}

TEST(Safetensors, RefusesAHeaderThatIsNoObjectOfTensors) {
  const SafetensorsParts parts = two_tensors();
  expect_refused(parts.with_header(""), {"no JSON object"});
  expect_refused(parts.with_header("[]"), {"no JSON object"});
  expect_refused(parts.with_header(" {}"), {"no JSON object"});
  expect_refused(parts.with_header("{"), {"no JSON"});
  expect_refused(parts.with_header("{\"a\":1}"), {"tensor \"a\"", "found 1", "an object"});
  expect_refused(parts.with_header("{\"__metadata__\":[]}"), {"__metadata__", "an array of 0"});
  expect_refused(parts.with_header("{\"__metadata__\":{\"k\":1}}"),
                 {"__metadata__.k: found 1", "a text"});
  expect_refused(parts.with_header(std::string("{\"\xff\":1}")), {"no JSON"});
}

TEST(Safetensors, RefusesAKeyThatStandsTwice) {
  SafetensorsParts parts;
  parts.tensor_bytes = "1234";
  const std::string entry = R"({"dtype":"F32","shape":[1],"data_offsets":[0,4]})";
  expect_refused(parts.with_header("{\"a\":" + entry + ",\"a\":" + entry + "}"),
                 {"key \"a\" twice"});
  expect_refused(
      parts.with_header(R"({"a":{"dtype":"F32","shape":[1],"shape":[1],"data_offsets":[0,4]}})"),
      {"key \"shape\" twice"});
}

TEST(Safetensors, RefusesDeepNestingBeforeItBuildsAnything) {
  expect_refused(two_tensors().with_header("{\"a\":" + std::string(100000, '[')),
                 {"nested more than 8 deep"});
}

TEST(Safetensors, RefusesBrokenEntriesByName) {
  expect_refused_entry("dtype", "BF16", {"dtype: found \"BF16\"", "F32, F16"});
  expect_refused_entry("dtype", 4, {"dtype: found 4"});
  expect_refused_entry("shape", {2, 2}, {"24 bytes", "16"});
  expect_refused_entry("shape", {2, -3}, {"shape[1]: found -3"});
  expect_refused_entry("shape", {2, 1.5}, {"shape[1]: found 1.5"});
  expect_refused_entry("shape", "6", {"shape: found \"6\""});
  expect_refused_entry("shape", {1, 1, 1, 1, 1, 1, 1, 2, 3}, {"an array of 9", "0 to 8"});
  expect_refused_entry("data_offsets", {0}, {"an array of 1"});
  expect_refused_entry("data_offsets", {24, 0}, {"data_offsets[1]: found 0", "at least 24"});
  expect_refused_entry("data_offsets", {0, 29}, {"found 29", "at most 28"});
  expect_refused_entry("data_offsets", {0, "24"}, {"data_offsets[1]: found \"24\""});
  expect_refused_entry("extra", 1, {"key \"extra\""});
  SafetensorsParts parts = two_tensors();
  parts.header["a"].erase("shape");
  expect_refused(parts.bytes(), {"tensor \"a\"", "shape: found nothing"});
}

TEST(Safetensors, RefusesShapesWhoseProductOverflows) {
  const std::uint64_t big = std::uint64_t{1} << 32U;
  // 2^64 numbers, and 2^62 of 4 bytes: both are 0 modulo 2^64.
  expect_refused_entry("shape", {big, big}, {"numbers that can be addressed"});
  expect_refused_entry("shape", {big, big / 4}, {"numbers that can be addressed"});
  expect_refused_entry("shape", {~std::uint64_t{0}, 0}, {"numbers that can be addressed"});
}

TEST(Safetensors, RefusesOverlapsAndGaps) {
  SafetensorsParts parts = two_tensors();
  parts.header["b"]["data_offsets"] = {20, 24};
  expect_refused(parts.bytes(), {"tensors that overlap at byte 20", "byte 24"});
  parts = two_tensors();
  parts.header["a"]["data_offsets"] = {4, 28};
  parts.header["b"]["data_offsets"] = {4, 8};
  expect_refused(parts.bytes(), {"a gap at byte 4", "byte 0"});
  parts = two_tensors();
  parts.header.erase("b");
  expect_refused(parts.bytes(), {"28 bytes after the header", "24"});
}

TEST(Safetensors, KeepsMessagesOnOneLineAndShort) {
  SafetensorsParts parts;
  parts.header[std::string(5000, 'n') + "\n\x1b[31m"] = 1;
  try {
    (void)parse_safetensors(as_bytes(parts.bytes()), "f");
    FAIL() << "not refused";
  } catch (const InputError& error) {
    const std::string text = error.what();
    EXPECT_LT(text.size(), 300U);
    EXPECT_EQ(text.find_first_of("\n\x1b"), std::string::npos);
  }
}

}  // namespace safetensors_test
}  // namespace stillmap::mapping
