# Run behind the build of a GoogleTest program: writes FILE, which adds a test for each of its suites, named as the suite.
# A test for each case, as gtest_discover_tests makes them, starts the program 2,300 times; loading its libraries took
# longer than the cases.
#   cmake -D PROGRAM=... -D FILE=... -D LABELS=... -D TIMEOUT=... -P GTestSuites.cmake
cmake_minimum_required(VERSION 3.25)
execute_process(COMMAND ${PROGRAM} --gtest_list_tests OUTPUT_VARIABLE listed COMMAND_ERROR_IS_FATAL ANY TIMEOUT 60)
string(REGEX MATCHALL "\n[^ \n][^ \n]*\\.( [^\n]*)?\n  " lines "\n${listed}")
# Nothing failed and nothing passed: what the suite needs is not there.
set(skipped [=[\[  PASSED  \] 0 tests\.
\[  SKIPPED \] [0-9]+ tests?, listed below:
(\[  SKIPPED \] [^
]*
)+$]=])
set(tests "")
foreach(line IN LISTS lines)
  string(REGEX REPLACE "^\n([^ \n]+)\\..*" "\\1" suite "${line}")
  string(APPEND tests "add_test([==[${suite}]==] [==[${PROGRAM}]==] [==[--gtest_filter=${suite}.*]==])\n"
    "set_tests_properties([==[${suite}]==] PROPERTIES LABELS [==[${LABELS}]==] TIMEOUT ${TIMEOUT} "
    "SKIP_REGULAR_EXPRESSION [==[${skipped}]==])\n")
endforeach()
if(tests STREQUAL "")
  message(FATAL_ERROR "${PROGRAM} --gtest_list_tests: found no suite in:\n${listed}")
endif()
file(WRITE ${FILE} "${tests}")
