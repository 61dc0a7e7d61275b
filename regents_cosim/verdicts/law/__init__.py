"""The law: where one may drive and walk, who has to give way, offences, and fault."""
