#include "http/multipart.hpp"

#include <gtest/gtest.h>

#include <string>

#include "errors/api_error.hpp"
#include "http/header_text.hpp"
#include "http/request_id.hpp"

namespace stillmap::server {
namespace multipart_test {

constexpr const char* kType = "multipart/form-data; boundary=b";

std::string part(const std::string& name, const std::string& content) {
  return "--b\r\ncontent-disposition: form-data; name=\"" + name + "\"\r\n\r\n" + content + "\r\n";
}

TEST(Multipart, PartsKeepTheirBytes) {
  const std::string binary("\0\r\n--\r\n--c\n", 11);
  const std::string body = part("one", binary) + part("two", "") + "--b--";
  const auto parts = split_multipart(kType, body);
  ASSERT_EQ(parts.size(), 2U);
  EXPECT_EQ(parts[0].name, "one");
  EXPECT_EQ(parts[0].content, binary);
  EXPECT_EQ(parts[1].content, "");
}

TEST(Multipart, MalformedBodiesAreRefused) {
  const std::string good = part("a", "x");
  for (const std::string& body : {std::string(), good, "x" + good + "--b--", good + "--b",
                                  good + "--bx", std::string("--b\r\nno colon\r\n\r\nx\r\n--b--"),
                                  std::string("--b\r\nname: a\r\n\r\nx\r\n--b--"),
                                  good + good + good + good + good + "--b--"}) {
    EXPECT_THROW(static_cast<void>(split_multipart(kType, body)), ApiError) << body;
  }
  EXPECT_THROW(static_cast<void>(split_multipart("multipart/form-data", good + "--b--")), ApiError);
}

TEST(Multipart, LongHeaderLinesCostNoStack) {
  const std::string body =
      "--b\r\nContent-Disposition: " + std::string(1 << 20, 'x') + "\r\n\r\nx\r\n--b--";
  EXPECT_THROW(static_cast<void>(split_multipart(kType, body)), ApiError);
}

TEST(HeaderText, ParametersArePlainOrQuoted) {
  EXPECT_EQ(parameter_of("form-data; name=\"a;b\"; filename=c", "name"), "a;b");
  EXPECT_EQ(parameter_of("form-data; name=\"a;b\"; FileName= c ", "filename"), "c");
  EXPECT_EQ(parameter_of("form-data; xname=1", "name"), "");
  EXPECT_EQ(parameter_of("form-data; name=\"open", "name"), "");
  EXPECT_EQ(parameter_of("form-data", "name"), "");
  EXPECT_EQ(media_type(" Text/HTML ; charset=utf-8"), "text/html");
}

TEST(RequestId, FreshOnesDiffer) {
  EXPECT_NE(new_request_id(), new_request_id());
  EXPECT_EQ(request_id_from("", "own"), "own");
  EXPECT_EQ(request_id_from(std::string(65, 'a'), "own"), "own");
  EXPECT_EQ(request_id_from("client-1", "own"), "client-1");
  EXPECT_EQ(printable("a\nb\x7f"), "a?b?");
}

}  // namespace multipart_test
}  // namespace stillmap::server
