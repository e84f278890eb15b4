#pragma once
#include <cstddef>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "common/crypto/crypto.hpp"
#include "common/fabric/tx/transaction.hpp"

/// Random proposals for an own endorser and its peer to answer, in process and on a real network.
namespace ledgerline::endorser {

/// What kinds there are, in fixed shares: random calls alone are refused nearly always.
enum class Kind { command, state, any, used_id, wrong_creator, expired_creator };
struct Share {
  Kind kind;
  int of_twenty;
  const char* name;
};
inline constexpr Share shares[] = {{Kind::command, 6, "good command"},
                                   {Kind::state, 2, "good state"},
                                   {Kind::any, 6, "any call"},
                                   {Kind::used_id, 2, "used id"},
                                   {Kind::wrong_creator, 2, "wrong creator"},
                                   {Kind::expired_creator, 2, "expired creator"}};
const char* name_of(Kind kind);

/// Who takes part, in this order. Random calls name the first four alone, so that what the last two need stays as it
/// is.
enum Who : std::size_t { host, admin, second_admin, second_operator, steady_holder, steady_host, people_count };
struct CallOf {
  Who who;
  fabric::Call call;
};
/// What good calls need: a drone that random ones do not name, flown by the steady holder. Once; all must be taken.
std::vector<CallOf> steady_calls(const std::vector<crypto::IdentityName>& people);
/// So that random calls of all kinds can succeed; again and again, since they revoke and evict people. Some may be
/// refused.
std::vector<CallOf> usual_calls(const std::vector<crypto::IdentityName>& people);

/// Those who sign as somebody that they are not, or as nobody; `other` is another member of the same organisation.
std::vector<crypto::SigningIdentity> wrong_creators(const crypto::SigningIdentity& one,
                                                    const crypto::SigningIdentity& other);

/// Kinds in their shares, and calls of every function: good ones, refusals, keys that are there and are not, pages, and
/// what is no call at all.
class Calls {
 public:
  Calls(std::uint64_t seed, std::vector<crypto::IdentityName> people) : random_(seed), people_(std::move(people)) {}

  /// Of any twenty that follow a multiple of twenty, each kind has its share.
  Kind next_kind();
  /// Good ones of the steady drone, by its holder and by its host.
  fabric::Call command();
  fabric::Call state();
  fabric::Call any();
  std::size_t pick(std::size_t count) { return random_() % count; }

 private:
  std::string drone() { return "tello" + std::to_string(1 + pick(6)); }
  std::string id() { return drone() + "/key" + std::to_string(pick(60)); }
  std::string word();
  std::string arguments_of(const std::string& function);

  std::mt19937_64 random_;
  const std::vector<crypto::IdentityName> people_;
  std::vector<Kind> deck_;
  std::int64_t setpoint_ns_ = 0;
};

}  // namespace ledgerline::endorser
