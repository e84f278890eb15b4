#pragma once
#include <string>
#include <vector>

namespace ledgerline {

/// Of what can be typed, that which was meant by `typed`: at most two edits away. Empty: nothing is that near.
std::string nearest_word(const std::string& typed, const std::vector<std::string>& known);
/// The same for people: `lead` and "did you mean WORD?". Empty: nothing is that near.
std::string did_you_mean(const std::string& lead, const std::string& typed, const std::vector<std::string>& known);

}  // namespace ledgerline
