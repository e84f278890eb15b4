#pragma once
#include <optional>
#include <string>
#include <vector>

#include "common/crypto/crypto.hpp"
#include "tools/checks/core/problem.hpp"

/// Whether an identity is one that the ledger takes, and whom this host trusts. Pure.
namespace ledgerline::checks {

struct IdentityInputs {
  std::string msp_id, place;  ///< `place`: its folder, or its certificate's file
  std::string certificate_pem{};
  std::string no_certificate{};  ///< why it was not read
  std::string key_pem{};
  std::string no_key{};      ///< why it was not read
  bool key_is_open = false;  ///< others may read it
  std::string key_file{}, certificate_file{};
  std::string msp_dir{};    ///< empty: two files are named
  std::string channel{};    ///< whose authorities it is checked against; empty: not known
  std::string forbidden{};  ///< the folder or file that this user may not read; empty: none
  std::string user{};       ///< this one
};

/// Whether bytes are of a certificate in binary form, and how to make PEM of it.
bool is_der(const std::string& bytes);
std::string cure_of_der(const std::string& file);

/// Of an organisation, by the channel's configuration or by the config's [[msp]].
struct AuthorityInputs {
  std::string msp_id;
  std::string pem;
};

/// `authorities`: of the organisation that the identity says, for whether they have issued it; empty: nobody knows.
Findings assess(IdentityInputs inputs, const std::vector<AuthorityInputs>& authorities, std::int64_t now_s);

/// The same of a pair that a program shows by TLS (tls_certificate, tls_key); whether a server takes it, that one says.
Findings assess_tls_pair(const IdentityInputs& inputs, const std::string& whose, std::int64_t now_s);

/// A config's [[msp]] against the organisations of the channel (empty: they are not known).
struct TrustInputs {
  std::string program;
  struct Msp {
    std::string id, file;
    std::string pem{}, why{};          ///< why it was not read
    std::optional<Problem> problem{};  ///< more exact than authority_unreadable
    std::string cure{};
  };
  std::vector<Msp> msps;
  std::vector<AuthorityInputs> channel;
};
Findings assess(const TrustInputs& inputs);

}  // namespace ledgerline::checks
