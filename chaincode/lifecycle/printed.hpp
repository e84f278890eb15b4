#pragma once
#include <string>
#include <vector>

#include "chaincode/lifecycle/lifecycle.hpp"
#include "common/fabric/client/client.hpp"

/// The same steps as commands of Fabric's `peer`, for those who may run only that. Pure.
namespace ledgerline::chaincode_lifecycle {

/// `client`: what its files and places are; `msp_dir`: as the peer's program wants it. What is not known stands in
/// capitals.
struct PeerCommands {
  const fabric::ClientConfig& client;
  std::string msp_dir;

  std::string environment() const;  ///< export lines, for all of them
  std::string install(const std::string& package_file) const;
  std::string approve(const Definition& definition, const std::string& package_id) const;
  std::string commit(const Definition& definition) const;
  std::string status() const;

 private:
  std::string to_orderer() const;
  std::string of(const Definition& definition) const;
};

}  // namespace ledgerline::chaincode_lifecycle
