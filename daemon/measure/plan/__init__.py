"""What a guided measurement consists of: stations, in the order to go to them."""
