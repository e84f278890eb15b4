#include "common/fabric/tx/cross_check.hpp"

#include <fmt/format.h>

namespace ledgerline::fabric {

std::string CrossCheck::add(Source source, std::uint64_t number, const std::string& hash) {
  const std::lock_guard lock(mutex_);
  auto& own = told_[static_cast<std::size_t>(source)];
  auto& other = told_[1 - static_cast<std::size_t>(source)];
  if (const auto found = other.find(number); found != other.end()) {
    ++compared_;
    if (found->second != hash) problem_ = fmt::format("block {} of the peer is not the one that was ordered", number);
    other.erase(found);
  } else {
    own[number] = hash;
    if (own.size() > max_kept) own.erase(own.begin());
  }
  return problem_;
}

std::uint64_t CrossCheck::compared() const {
  const std::lock_guard lock(mutex_);
  return compared_;
}

}  // namespace ledgerline::fabric
