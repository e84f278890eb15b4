#pragma once
#include <string>
#include <vector>

#include "common/base/random.hpp"
#include "tests/fuzz/entry.hpp"

namespace ledgerline::fuzz {

/// One of the seeds, spoilt one to six times: bits, bytes, interesting integers, lengths, cuts, repetitions, splices
/// with another seed; for text also tokens (numbers beyond every range, broken UTF-8, deep nesting); for protobuf also
/// fields, at any depth, with the lengths around them made right again, so that the change reaches the inner messages.
/// The same random numbers give the same input. Some inputs stay valid.
std::string mutate(Random& random, const std::vector<std::string>& seeds, Kind kind);

/// Longer inputs are cut off: what is refused for its length is for plain tests.
inline constexpr std::size_t max_input_bytes = 40'000;

}  // namespace ledgerline::fuzz
