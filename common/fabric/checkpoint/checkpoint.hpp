#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "common/base/result.hpp"

namespace ledgerline::fabric {

/// The newest block that a program has verified, so that a peer cannot show it another chain, or an older one, when it
/// starts again.
struct Checkpoint {
  std::string channel;
  std::uint64_t number = 0;
  std::string hash;     ///< of the block's header, as ChainCheck has it
  std::string records;  ///< what the program itself verified behind that block; any bytes
};

/// As it is in a file: lines, the records, and a SHA-256 of all of it, which detects a torn or overwritten file. It is
/// no protection against a writer of the file, who can write the right sum.
std::string to_text(const Checkpoint& checkpoint);
/// An error: it is not whole, or of another kind.
Result<Checkpoint> checkpoint_from(std::string_view text);

/// None where there is no file, or no path. A damaged file, or one of another channel, is an error that says what to
/// do: never silently a start without one.
Result<std::optional<Checkpoint>> read_checkpoint(const std::string& path, const std::string& channel);
/// With mode 0600, whole or not at all, on the disk when it returns.
Status write_checkpoint(const std::string& path, const Checkpoint& checkpoint);

}  // namespace ledgerline::fabric
